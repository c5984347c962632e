"""The collector process: one small gate on the robot that lets exactly one side's outputs through.

`gate` decides for each message, `state` is its state. `standby` keeps the newest message of a Hot replica, `lateness`
detects that a message of the cloud is overdue, `active_while` determines when an output must publish, `results` handles
outputs of nodes with placement Cloud, `rivals` finds other publishers of a collected topic.

Never here: a wish of its own. The gate obeys control, and falls back to the robot when control is silent.
"""
