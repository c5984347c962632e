"""Judges a run afterwards, from what a recorder at the consumers heard: measures, broken promises, report."""
