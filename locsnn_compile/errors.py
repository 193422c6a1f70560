"""The compiler's errors are those of :mod:`hw_model.errors`; one tree for both packages."""

from hw_model.errors import *  # noqa: F403
