"""Replays a recorded link against switching policies: who would have acted when, and what that would have cost.

heartbeats.py   what a recorded link would have done to an agent's heartbeats
contract.py     what a policy is: it receives echoes, is asked for a side, and never sees the future
ours.py         the agents' rule, run through the agents' own code
peers.py        other rules to compare with
named.py        policies by name, and a user's own by `module:function`
play.py         one policy on one recording, moment by moment
costs.py        the price of a placement, and the least that was possible with the whole recording known
study.py        recordings and policies put together; outcomes as plain values for JSON
tune.py         searches figures of our rule on some recordings and reports on another
show.py, picture.py   outcomes as text and as a picture

It does not simulate the protocol (robot_offload_sim does): changing over takes no time here and never
fails, so that policies differ only in their decisions.
"""
