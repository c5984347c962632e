"""The collector process: which side's message passes, in front of the consumers."""
