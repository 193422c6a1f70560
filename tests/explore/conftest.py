"""Fixtures of all tests of explorations."""

from small_model import divided, events, model

__all__ = ["divided", "events", "model"]
