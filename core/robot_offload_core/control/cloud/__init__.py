"""The lease, seen from the cloud.

`lease` determines how long the cloud may be active: from the time stamps of its own heartbeats that the robot echoes,
so that no two clocks are compared. `process` adds the reports of the cloud's control process.

Never here: a wish to be active. The robot decides, the cloud holds a lease. Serves the cloud's control process.
"""
