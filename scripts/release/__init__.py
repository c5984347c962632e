"""Makes everything that a release publishes: `python -m scripts.release`, also `make release`."""
