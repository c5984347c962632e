"""What must hold in every execution, and the observers that watch it.

An exception to a promise is documented here with its reason.

Never here: knowledge of which fault is under way, unless the promise itself names it.
"""
