"""An emulated link between two sides on one machine: delay, jitter, loss, rate, outages."""
