"""Shows a run while it runs: a live picture or one line per event, and a summary at the end."""
