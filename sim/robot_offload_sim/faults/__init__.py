"""What goes wrong: kinds of faults, where and when they strike, drawn from a seed.

Never here: what should follow from a fault (`promises/`).
"""
