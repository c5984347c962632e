"""The reporter: a small container beside the cloud agent that reports the agent's state to the cluster.

It reads the agent's state file and mirrors it to the robot's coordination Lease (at most every ten seconds, and at each
transition), answers probes, serves metrics, and asks the agent to hand over before a pod of the active side stops.

`state` and `mirror` are pure: text and time in, decisions out. Only `leases` talks to the API server.
"""
