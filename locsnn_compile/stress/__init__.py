"""Numbers and inputs at the limits of what a network can have: what the chip does with them, and why."""
