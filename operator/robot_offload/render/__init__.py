"""Pure functions that turn a RobotOffload into the texts and objects that others read."""
