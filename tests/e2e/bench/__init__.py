"""The figures of a real cluster with a robot outside it: `python -m tests.e2e.bench`, also `make bench-e2e`."""
