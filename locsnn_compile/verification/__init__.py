"""Compare the chip's program with the float network, and explain where they differ."""
