"""The fence: the only code that decides whether bytes pass, small enough to be explored completely.

Four parts, each a frozen state and pure functions over it. `grant` is the robot's: which side is in charge, which gets
ready, from when the robot's own effects are clear. `lease` is the cloud's: what a grant allows, and until when.
`gate` is the collector's: which message reaches the consumers. `freshness` bounds ages. `memory` is the record from
which a restarted collector continues.

Everything else may only ask for less: standby, lateness, floors, policies, reports. Nothing outside builds one of these
states or changes a field of one (tests/contract/test_fence.py); the functions are the whole surface. Nothing in here
imports anything but the standard library. Time is passed in, on the steady clock of the host that asks; no clocks of
two hosts are compared.

Every interleaving of these four parts is explored in `tests/simulation/fence`. A change of a line in here needs a
decision record; docs/explanation/fence.md states what exploration covers and what it does not.
"""
