"""Neuromorphic chips: their arithmetic and limits, programs for them, and a simulator that counts operations.

The chips are one like Intel's Loihi, Xylo, SpiNNaker 1 and an open core. The package knows nothing of training, and
imports neither torch nor the compiler.
"""

from pathlib import Path

import lazy_loader

if not Path(__file__).parent.is_dir():
    # The package is imported from a zip archive. An ImportError with the name of the package makes `python -m hw_model`
    # print one line instead of a traceback.
    message = (
        "it reads files of its own, and an archive has none. Unpack it, or install it with pip."
    )
    raise ImportError(f"{__name__}: {message}", name=__name__)

# The names are those of the stub next to this file; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
