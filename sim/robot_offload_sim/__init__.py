"""The protocol in virtual time: every process of both agents runs the core's own code, the world around is simulated.

`world/` is time, hosts, the link and the nodes. `sides/` are the processes of robot and cloud. `faults/` are what goes
wrong and when. `promises/` are the observers: what must hold, whatever happens. `stories/` are single executions with
one point each. `mutants/` are faults planted in the core, which a story or a campaign must find. `campaign` lives many
short stretches with chance faults, `main` is the command.

Never here: the agent, ROS, a real clock. The package needs the core alone.
"""
