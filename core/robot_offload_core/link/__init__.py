"""What is known of the network between robot and cloud, and what to expect of it.

`links` measures round trips, losses and silence. `experts` compares simple rules by the history of the link, `prior`
holds their starting weights, `momentary` shows the present state to people. `policies` turns them into one verdict: may
the cloud be active now?

Never here: which side is active (that is `control`), a socket, a clock. Serves the control processes of both sides; the
replay of recorded links uses the same functions.
"""
