"""The first two levels: a trained network, and the same in the chip's integers."""
