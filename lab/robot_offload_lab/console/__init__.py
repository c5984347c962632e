"""The console's sources on a developer's machine: the running demo, a recording of one, and other rules to compare."""
