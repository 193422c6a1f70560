"""Compile trained time and location spiking networks to a Loihi-like chip, and check the result.

>>> import locsnn_compile as lc
>>> network = lc.load("examples/models/objects-hybrid.pt")
>>> compiled = lc.compile(network, target="loihi-sim")
>>> compiled.report["match"]["prediction_agreement"]
1.0
"""

from pathlib import Path

import lazy_loader

__version__ = "0.1.0"

# Python can import a package from a .zip, but this one reads data files that lie next to its modules.
if not Path(__file__).parent.is_dir():
    # With the name of the package, `python -m locsnn_compile` prints this in one line.
    message = (
        "it reads files of its own, and an archive has none. Unpack it, or install it with pip."
    )
    raise ImportError(f"{__name__}: {message}", name=__name__)

# The names are those in the stub next to this file; each is imported on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
