"""What happens to the messages of one topic on their way between the sides.

Here are the parts that the data process, the collector and the relay have in common: topics with several publishers
(`shared`), transforms, snapshots of a node's state, pacing and thinning on a narrow link, waiting times inside a host
(`waits`, `pauses`), the copy for consumers in the cloud (`mirror`), counters (`tallies`).

Never here: the question whether a side may speak (that is the gate's), ROS, a queue of a middleware.
"""
