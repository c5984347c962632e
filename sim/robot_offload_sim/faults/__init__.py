"""What goes wrong: kinds of faults, where they strike, and when, drawn from a seed.

Never here: what should follow from a fault (`promises/`).
"""
