"""The decisions of the operator: pure functions from what was observed to what is written.

No I/O, no clock, no environment: the controller reads the cluster and the clocks and passes both in. Decisions have a
reason (one CamelCase word for machines) and a message (a sentence for people). The same functions decide what is done
and what the conditions report.
"""
