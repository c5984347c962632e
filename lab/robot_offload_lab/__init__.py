"""Robot Offload on a developer's machine: nothing in here runs on a robot or in a cluster.

wire/      an emulated link: delay, jitter, loss, outages; relays for Zenoh and for DDS
links/     what a link does over time: recorded and made up
run/       one RobotOffload on one machine: programs, processes, certificates, the demo
show/      a run while it runs: live picture, lines, summary
judge/     a run afterwards: recording, measures, promises, report
replay/    a recorded link against switching rules
bench/     measurements of what the product claims
cluster/   a small real Kubernetes for tests and measurements
images/    builds the project's own images
cli/       `robot-offload demo`, `simulate`, `bench`

The protocol in virtual time is a package of its own, `sim/`.
"""
