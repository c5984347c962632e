"""What the agent writes down: the black box, the link as CSV, recordings of switches as MCAP.

Each writer takes what the processes hand over and never holds one up: a full disk costs the record, not the drive.

Never here: a decision, a message on its way to a consumer.
"""
