"""Running what is measured, one module per group of figures; what came of it is judged in `analysis`."""
