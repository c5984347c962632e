"""What the controller is made of: reading the cluster, carrying out a plan, its queue, its leadership, its health.

I/O and clocks live here; every decision is in `reconcile`.
"""
