"""Measurements of what the product claims, by programs outside of it. See `main`."""
