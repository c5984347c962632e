"""The processes of robot and cloud, driven as the agent drives them.

Each wraps the core's class of the same name with virtual time, an inbox and ports of the simulated world.

Never here: a decision that the core does not take.
"""
