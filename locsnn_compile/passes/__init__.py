"""Rounding and lowering, by neuron type."""
