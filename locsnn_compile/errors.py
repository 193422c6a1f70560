"""The errors of the compiler are those of :mod:`hw_model.errors`: both packages share one tree."""

from hw_model.errors import *  # noqa: F403
