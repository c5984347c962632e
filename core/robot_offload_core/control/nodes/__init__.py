"""The managed nodes of one side.

`managed_nodes` drives one lifecycle node from state to state with deadlines. `guardians` drives the group: in order,
CORE nodes first, and a failed node does not hold up the others. `replica_parameters` compares the parameters of both
replicas, `rest` determines when nodes may be deactivated.

Never here: which side is active. Serves the control processes of both sides.
"""
