"""The managed nodes of one side.

`managed_nodes` drives one lifecycle node from state to state with deadlines, `guardians` drives the group: in order,
CORE nodes first, one failure holds up no other. `replica_parameters` compares the parameters of both replicas, `rest`
says when nodes may be deactivated.

Never here: which side is active. Serves the control processes of both sides.
"""
