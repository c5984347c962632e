"""Starting weights of the outlook's rules, learned on other links and used until this link has taught enough.

The figure of a rule is its cost on other links, as a multiple of the cost of the best fixed rule there: the mean of the
logarithm over 96 made-up links of 20 minutes, 12 seeds of each of the families mobile, roaming, periodic, fibre,
evening, diurnal, two-states and lossy (`robot_offload_lab.links.made_up`; `robot_offload_lab.replay.learn` prints this
table). Links of other families and recordings of real links were not used.

The signal of a rule is bad if the newest latency exceeds `share` of the limit, or if a second beat is overdue. `out`
and `back` are the regrets, in prices of a switch, at which the rule leaves the cloud and returns. With a memory, the
signal for returning stays bad while more than a share of a window's beats were truly bad, as known one limit later.
"""

from __future__ import annotations

MEMORIES: tuple[tuple[float, float], ...] = ((1.0, 0.10),)
"""(window in seconds, share of bad beats); a rule names one by its place, counted from 1. With two more, (3 s, 10 %)
and (3 s, 20 %), the leader on 48 held-out links was the same."""

# share, out, back, memory: mean log of cost / best fixed rule
PRIOR: tuple[tuple[float, float, float, int, float], ...] = (
    (1, 0.2, 0.04, 0, 0.905),
    (1, 0.2, 0.2, 0, 0.433),
    (1, 0.2, 0.5, 0, 0.342),
    (1, 0.2, 1, 0, 0.343),
    (1, 0.2, 2, 0, 0.397),
    (1, 0.2, 4, 0, 0.539),
    (1, 0.2, 8, 0, 0.774),
    (1, 0.8, 0.04, 0, 0.752),
    (1, 0.8, 0.2, 0, 0.287),
    (1, 0.8, 0.5, 0, 0.209),
    (1, 0.8, 1, 0, 0.216),
    (1, 0.8, 2, 0, 0.276),
    (1, 0.8, 4, 0, 0.421),
    (1, 0.8, 8, 0, 0.671),
    (1, 6, 0.04, 0, 0.641),
    (1, 6, 0.2, 0, 0.208),
    (1, 6, 0.5, 0, 0.156),
    (1, 6, 1, 0, 0.170),
    (1, 6, 2, 0, 0.227),
    (1, 6, 4, 0, 0.363),
    (1, 6, 8, 0, 0.600),
    (0.7, 3, 0.5, 0, 0.176),
    (0.7, 3, 1, 0, 0.190),
    (0.7, 3, 2, 0, 0.248),
    (0.7, 3, 4, 0, 0.393),
    (0.7, 3, 8, 0, 0.636),
    (0.7, 3, 16, 0, 0.937),
    (0.7, 20, 0.5, 0, 0.149),
    (0.7, 20, 1, 0, 0.168),
    (0.7, 20, 2, 0, 0.227),
    (0.7, 20, 4, 0, 0.372),
    (0.7, 20, 8, 0, 0.612),
    (0.7, 20, 16, 0, 0.912),
    (1, 0.8, 0.04, 1, 0.370),
    (1, 0.8, 0.5, 1, 0.247),
    (1, 0.8, 2, 1, 0.361),
    (1, 3, 0.04, 1, 0.261),
    (1, 3, 0.5, 1, 0.205),
    (1, 3, 2, 1, 0.320),
    (1, 20, 0.04, 1, 0.260),
    (1, 20, 0.5, 1, 0.203),
    (1, 20, 2, 1, 0.318),
)
