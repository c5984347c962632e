"""From what the observers wrote to figures: pure, one module per group of figures."""
