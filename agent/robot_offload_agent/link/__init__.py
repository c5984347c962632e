"""How the two agents reach each other: `zenoh` (their own sessions) or `ros` (topics over a DDS transport)."""
