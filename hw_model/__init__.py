"""A Loihi-like chip: its arithmetic and limits, programs for it, and a simulator that counts.

It knows nothing of training, and imports neither torch nor the compiler.
"""

import lazy_loader

# The names are those of the stub next to this file; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
