"""Spike response neurons: integers for them, and their lowering strategies."""
