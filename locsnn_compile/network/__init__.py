"""The first two levels: a trained network, and the same network in the chip's integers."""
