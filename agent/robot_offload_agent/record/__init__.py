"""What the agent records: the black box, the link as CSV, switches as MCAP.

Each writer takes what the processes pass to it and never blocks one: a full disk costs the record, not the drive.

Never here: a decision, a message on its way to a consumer.
"""
