"""Records for later: the black box, from which an incident is replayed as a test.

The recorder sees events and commands of every process by name, so this room imports the others, and none imports it.

Never here: a decision. A full disk or a slow recorder does not affect the other rooms.
"""
