"""A Loihi-like chip: its arithmetic and limits, programs for it, and a simulator that counts.

It knows nothing of training, and imports neither torch nor the compiler.
"""

from pathlib import Path

import lazy_loader

if not Path(__file__).parent.is_dir():
    # With the name of the package, `python -m hw_model` says this in one line.
    message = (
        "it reads files of its own, and an archive has none. Unpack it, or install it with pip."
    )
    raise ImportError(f"{__name__}: {message}", name=__name__)

# The names are those of the stub next to this file; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
