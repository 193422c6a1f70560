"""How much trouble the rounding of float numbers takes: none by default, all of it in ``FINE``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rounding:
    """What is done beyond rounding every weight to the nearest of one format.

    ``fitted_decays``: two decays an alpha dendrite, those whose response fits the kernel best. ``graded``: weights of a
    population in up to :data:`~locsnn_compile.passes.rounding.grades.GRADES` formats, each in the finest that holds it.
    What needs calibration recordings: ``error_aware`` rounds the weights of a neuron together, for the least error of
    its potential; ``scaled_apart`` gives neurons scales of their own. ``split``: the share of weights, 0 to 1, that get
    a second synapse for what their format cannot hold.
    """

    fitted_decays: bool = False
    graded: bool = False
    error_aware: bool = False
    scaled_apart: bool = False
    split: float = 0.0


NEAREST = Rounding()
FINE = Rounding(fitted_decays=True, graded=True, error_aware=True, scaled_apart=True)
