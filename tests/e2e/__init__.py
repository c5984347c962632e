"""Whole stories: a robot outside a real cluster, joined to it by a link that fails as it is told to."""
