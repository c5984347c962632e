"""What would bite on this robot, found before it does: `robot-offload-agent doctor`."""
