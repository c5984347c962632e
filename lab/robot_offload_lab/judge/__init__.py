"""Judges a run afterwards, from what a recorder at the consumers received: measures, broken promises, report."""
