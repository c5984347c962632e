"""The collector process: one small gate on the robot that lets exactly one side's outputs through.

`gate` decides for each message, `state` is what it remembers. `standby` keeps the newest message of a Hot replica,
`lateness` notices that a message of the cloud is overdue, `active_while` knows when an output has to speak, `results`
are the outputs of nodes with placement Cloud, `rivals` are other publishers of a collected topic.

Never here: a wish of its own. The gate obeys control, and falls back to the robot when control is silent.
"""
