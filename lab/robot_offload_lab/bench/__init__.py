"""Measurements: what the product claims, measured by programs outside of it. See `main`."""
