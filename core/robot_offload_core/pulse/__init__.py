"""The pulse process: fifty heartbeats a second in each direction.

A heartbeat carries what control wants to be known on the other side (the lease, a report) and for how long that is
vouched for. This room decides what a heartbeat says when control has not spoken lately.

Never here: what to grant, and whether the link is good. Serves the pulse process of both sides.
"""
