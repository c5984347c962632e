"""The control process: decide which side is active, and bring the nodes of a side into the matching state.

`robot/` decides the placement: it grants the lease, plans switches and takes over. `cloud/` holds the lease. `nodes/`
brings the managed nodes of a side into the state that placement asks for. `process` is shared by both control
processes.

Never here: a message of a node, a goal, a socket. Findings of other processes arrive as events; orders to them leave as
commands. Serves the control processes, one on each side.
"""
