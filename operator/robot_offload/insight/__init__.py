"""Explains a cluster's state to people: the observation, its reason, and the next step."""
