"""The pure switching core of Robot Offload.

No I/O, no clock, no threads, no ROS: every function takes the present and returns the next state with commands for a
shell to carry out. Time arrives inside the calls as seconds of one host's steady clock (`now_s`); times of two hosts
are never compared. The main flow, robot side: `pulse` composes and hears beats, `link` turns them into health,
`policy` into a verdict, `switcher` into placement, `guardian` into lifecycle transitions, `collector` into which
message passes. Cloud side: `lease`.
"""
