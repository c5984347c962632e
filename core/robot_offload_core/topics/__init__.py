"""What happens to the messages of one topic on their way between the sides.

The data process, the collector and the relay share these parts: topics with several publishers (`shared`), transforms,
snapshots of a node's state, pacing and thinning on a narrow link, waiting times inside a host (`waits`, `pauses`), the
copy for consumers in the cloud (`mirror`), counters (`tallies`).

Never here: whether a side may publish (that is the gate's decision), ROS, a queue of a middleware.
"""
