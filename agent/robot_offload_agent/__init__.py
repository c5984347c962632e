"""The agent of Robot Offload: runs on the robot and, mirrored, in the cloud; a thin shell around robot_offload_core.

One supervisor a side (`supervisor`) forks `control` (the decisions and the three lifecycle nodes), `pulse` (beats
only), `data` (topics and egress) and, on the robot, `collector` (which side's message passes). They communicate by unix
datagrams (`bus`) and reach the other side through a link (`link/`).
"""
