"""The lease, seen from the cloud.

`lease` counts how long the cloud may be active: from the time stamps of its own heartbeats that the robot echoes, so
that no two clocks are compared. `process` adds what the cloud's control process reports.

Never here: a wish to be active. The robot decides, the cloud holds a lease. Serves the cloud's control process.
"""
