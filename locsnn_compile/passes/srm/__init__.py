"""Integers for spike response neurons, and their lowering strategies."""
