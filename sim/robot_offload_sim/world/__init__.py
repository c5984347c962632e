"""The simulated world: virtual time, hosts and processes, the link, nodes, drivers and servers.

Never here: a judgement, and code of the product. What happens here is what the processes of `sides/` see.
"""
