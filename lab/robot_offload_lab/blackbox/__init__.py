"""Reads the black boxes of agents: replays them with the core of this release, cuts them, makes tests of them.

ring.py     the lines of a file or a folder, with the time of day
decided.py  what a replay comes to: decisions, differences, states before and after
cut.py      a part of a box that is replayed as it is
story.py    a part of a box as a test
"""
