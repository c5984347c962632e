"""The agent's settings and their storage: parameters, override, offered and adopted settings, notes, cluster files."""
