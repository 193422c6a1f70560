"""The errors of the compiler are those of :mod:`hw_model.errors`: both packages share one tree.

``InputError`` is for something that the user gave, ``TargetError`` for a model that a chip cannot hold.
"""

from hw_model.errors import *  # noqa: F403 - every name, so that they can be imported from here
