"""Fixtures of all tests of explorations."""

from tests.support.explored_model import cluster, divided, events, model

__all__ = ["cluster", "divided", "events", "model"]
