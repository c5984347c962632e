"""The only package that talks to the Kubernetes API server: dicts in, dicts out, errors of our own tree.

`port` declares the possible requests, `client` makes them, `kinds` lists every kind of object with the verbs used on it
(the ClusterRole is checked against that table), `errors` is what can go wrong.
"""
