"""Faults planted in the core on purpose, and the stories that must find them: proof that the simulation has teeth."""
