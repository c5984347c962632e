"""Builds the project's own images."""
