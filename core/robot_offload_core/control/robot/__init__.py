"""Placement: the robot's state machine that decides which side is active.

`placement` is the state, `switcher` its step. The switcher asks in this order: `limits` (what ends the cloud's turn at
once), `requests` (what people and the resource want), the policy of the link, `readiness` (what a planned switch waits
for). `changeovers` assigns epochs and tokens, `levels` holds what control renews with every heartbeat. `fast_takeover`,
`stalls`, `settling`, `health` and `availability` judge one thing each.

Never here: how nodes are activated (`nodes/`), which messages pass (the collector). Serves the robot's control process.
"""
