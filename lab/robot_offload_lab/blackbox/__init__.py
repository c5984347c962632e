"""Reads the black boxes of agents: replays them with the core of this release, cuts them, makes tests of them.

ring.py     the lines of a file or a folder, with the time of day
decided.py  the outcome of a replay: decisions, differences, states before and after
cut.py      a part of a box that can be replayed by itself
story.py    a part of a box as a test
"""
