"""The reporter: a small container beside the cloud agent that reports to the cluster what the agent knows.

It reads the agent's state file and mirrors it to the robot's coordination Lease (at most every ten seconds, and at each
transition), answers probes, serves metrics, and asks the agent to hand over before a pod of the acting side goes.

`state` and `mirror` are pure: text and time come in, decisions go out. Only `leases` talks to the API server.
"""
