"""Shows a run while it runs: a live picture or a line an event, and a summary at the end."""
