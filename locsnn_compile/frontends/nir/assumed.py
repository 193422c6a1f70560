"""What a NIR graph leaves open, and how it was read: in sentences, for the report."""

from __future__ import annotations

from locsnn_compile.frontends.nir.flat import FlatGraph

DT_SECONDS = 1e-4
"""The step by convention: NIR files do not hold one."""
_IN_SECONDS = ("IF", "LIF", "CubaLIF", "LI", "CubaLI", "Delay")
_WITH_TAU = ("LIF", "CubaLIF", "LI", "CubaLI")
_WITH_RESET = ("IF", "LIF", "CubaLIF")


def nir_assumptions(
    flat: FlatGraph, dt: float | None, reset: str | None, discretisation: str | None
) -> tuple[str, ...]:
    """Return a sentence for each of the three that is None, where a node of the graph depends on it."""
    rows = (
        (
            dt,
            _IN_SECONDS,
            f"The NIR graph does not say how long a step is: its constants were read in steps of {DT_SECONDS:g} s, "
            "the convention (--dt).",
        ),
        (
            reset,
            _WITH_RESET,
            "The NIR graph does not say how a spike resets: its potential goes to v_reset at once (--reset zero).",
        ),
        (
            discretisation,
            _WITH_TAU,
            "The NIR graph does not say how its equations become steps: by Euler's method (--discretisation euler).",
        ),
    )
    return tuple(sentence for given, kinds, sentence in rows if given is None and flat.named(*kinds))
