"""Placement: the robot's state machine that decides which side is active.

`placement` is the state, `switcher` the step over it. The switcher asks in this order: `limits` (what ends the cloud's
turn at once), `requests` (what people and the resource want), the policy of the link, `readiness` (what a planned
switch waits for). `changeovers` names epochs and tokens, `levels` is what control renews with every heartbeat.
`fast_takeover`, `stalls`, `settling`, `health` and `availability` judge one thing each.

Never here: how nodes are activated (`nodes/`), what passes (the collector). Serves the robot's control process.
"""
