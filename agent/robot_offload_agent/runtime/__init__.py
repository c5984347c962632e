"""How the agent's processes live: supervisor, datagrams between them, priorities, pauses, clock."""
