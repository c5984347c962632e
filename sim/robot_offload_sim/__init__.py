"""The protocol in virtual time: every process of both agents runs the core's own code in a simulated world.

`world/` has time, hosts, the link and the nodes. `sides/` has the processes of robot and cloud. `faults/` determines
what goes wrong and when. `promises/` has the observers: what must always hold. `stories/` has single executions with
one point each. `mutants/` has faults planted in the core, which a story or a campaign must find. `campaign` runs many
short stretches with random faults; `main` is the command.

Never here: the agent, ROS, a real clock. The package needs only the core.
"""
