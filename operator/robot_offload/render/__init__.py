"""Pure functions that turn a RobotOffload into texts and objects for others to read."""
