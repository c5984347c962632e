"""The relay process: service calls and goals that survive a change of the active side.

A client talks to the relay, the relay talks to the replica of the active side. `robot` and `cloud` are the two ends,
`process` what they share, `post` numbers and repeats what must arrive. `robot_used`, `cloud_used` and `robot_requests`
are the servers outside the group that replicas call. The books are kept in `goals/`.

Never here: which side is active. Serves the relay process of both sides.
"""
