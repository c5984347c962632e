"""The control process: who is active, and what the nodes of a side have to do for it.

`robot/` places: it grants the lease, plans switches, takes over. `cloud/` holds the lease. `nodes/` brings the managed
nodes of a side into the state that placement asks for. `process` is what both control processes have in common.

Never here: a message of a node, a goal, a socket. What other processes found out arrives as an event; what they shall
do leaves as a command. Serves the control processes, one on each side.
"""
