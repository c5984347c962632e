"""Find problems on this robot before the first drive: `robot-offload-agent doctor`."""
