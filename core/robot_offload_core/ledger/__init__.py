"""Nothing lost: the goals and requests that the relays of both sides hold, and what becomes of them at a change.

Every machine here is pure: `step(state, event, now) -> (state, commands)`. The classes `process.robot_relay.RobotRelay`
and `process.cloud_relay.CloudRelay` put the machines together; a shell carries out what they command.
"""
