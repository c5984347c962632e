"""Computes figures from what the observers wrote: pure, one module per group of figures."""
