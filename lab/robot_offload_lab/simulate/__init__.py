"""The protocol in virtual time: the real core, both sides, against modelled link, processes, nodes and driver."""
