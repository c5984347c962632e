"""`kubectl offload doctor`: finds what would bite, before it does."""
