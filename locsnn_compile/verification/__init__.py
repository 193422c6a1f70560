"""Does the chip do what the network does, and where not, why."""
