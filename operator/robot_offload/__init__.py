"""Robot Offload beside the robot: API types, rendering, command line, demo, simulation and benches."""
