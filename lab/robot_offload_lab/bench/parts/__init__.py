"""The programs that a measurement starts beside the product: a user's nodes, and observers. Each is a process."""
