"""Fixtures of all tests of explorations."""

from small_model import cluster, divided, events, model

__all__ = ["cluster", "divided", "events", "model"]
