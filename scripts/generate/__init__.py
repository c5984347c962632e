"""Writes every file that is derived from the models: definition, reference."""
