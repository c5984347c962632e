"""What is kept for later: the black box, from which an incident is replayed as a test.

The recorder sees events and commands of every process by name, so this room stands above all others, and nothing
imports it back.

Never here: a decision. A full disk or a slow recorder changes nothing in what the other rooms do.
"""
