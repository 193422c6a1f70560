"""Losses, the training loop and what decides a run."""
