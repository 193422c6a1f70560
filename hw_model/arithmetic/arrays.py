"""Names that moved: import them from :mod:`hw_model.values`."""

from hw_model.values import *  # noqa: F403
