"""What is known of the network between robot and cloud, and what to expect of it.

`links` measures: round trips, losses, silence. `experts` hold simple rules against the history of the link, `prior`
their starting weights, `momentary` the rule that sees the present alone; `policies` make one wish out of them: may the
cloud be active now?

Never here: who is active (that is `control`), a socket, a clock. Serves the control processes of both sides; the
replay of recorded links uses the same functions.
"""
