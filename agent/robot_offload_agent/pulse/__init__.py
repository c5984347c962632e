"""The pulse process: beats and leases only."""
