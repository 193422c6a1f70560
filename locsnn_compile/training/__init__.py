"""Losses, the training loop, and the options of a run."""
