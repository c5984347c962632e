"""Explains a cluster's state to people: what was observed, why it is so, and the next step."""
