"""The pulse process: fifty heartbeats a second in each direction.

A heartbeat carries what control wants the other side to know (the lease, a report) and how old that is. This room
decides what a heartbeat carries when control has been silent for a while.

Never here: what to grant, and whether the link is good. Serves the pulse process of both sides.
"""
