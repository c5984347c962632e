"""Links over time, recorded or made up: round-trip times by the second, including losses."""
