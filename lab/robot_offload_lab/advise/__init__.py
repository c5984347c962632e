"""What to move: cuts of a robot's graph that save processor time under the link's bandwidth and latency."""
