"""Integers for spike response model (SRM) neurons, by lowering strategy."""
