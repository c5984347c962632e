"""The only place that talks to the Kubernetes API server: dicts in, dicts out, errors of our own tree.

`port` says what the rest of the program may ask for, `client` does it, `kinds` lists every kind of object with the
verbs that are used on it (the ClusterRole is checked against that table), `errors` is what can go wrong.
"""
