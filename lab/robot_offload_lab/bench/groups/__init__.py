"""Runs the measurements, one module per group of figures; `analysis` judges the results."""
