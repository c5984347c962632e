"""The books of the relay: every goal and every call, from its request to its one result.

`state` is the book, `machine` the step over it, `attempts` the executions of a goal on either side, `requests` the
calls. `journal` writes what a restart needs. `wire_ids` and `words` define the form on the link.

Never here: ROS. An attempt is begun, cancelled and queried through commands. Serves the relay of both sides.
"""
