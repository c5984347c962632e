"""The relay: the only process of the agent that serves and calls; goals and requests pass through it."""
