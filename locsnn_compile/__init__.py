"""Compile trained time and location spiking networks to a Loihi-like chip, and check the result.

>>> import locsnn_compile as lc
>>> network = lc.load("examples/models/objects-hybrid.pt")
>>> compiled = lc.compile(network, target="loihi-sim")
>>> compiled.report["match"]["prediction_agreement"]
1.0
"""

import lazy_loader

__version__ = "0.1.0"

# The names are those in the stub next to this file; each is imported on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
