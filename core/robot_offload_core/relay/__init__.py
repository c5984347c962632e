"""The relay process: service calls and goals that survive a change of the active side.

A client talks to the relay, the relay talks to the replica of the active side. `robot` and `cloud` are the two ends,
`process` is what they share, `post` numbers messages and repeats them until they arrive. `robot_used` and `cloud_used`
handle the servers outside the group that replicas call, `robot_requests` the calls of clients outside the group. The
books are kept in `goals/`.

Never here: which side is active. Serves the relay process of both sides.
"""
