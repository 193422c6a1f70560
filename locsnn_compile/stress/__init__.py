"""Numbers and inputs at the ends of what a network can have: what the chip makes of them, and why."""
