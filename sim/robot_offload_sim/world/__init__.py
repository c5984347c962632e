"""The simulated world: virtual time, hosts and processes, the link, nodes, drivers and servers.

Never here: a judgement, or code of the product. The processes of `sides/` see only what happens here.
"""
