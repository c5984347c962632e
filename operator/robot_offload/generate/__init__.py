"""Writes what is generated from the models, or tells what is out of date: `make generate`, `make verify`."""
