"""The API types, one package per version."""
