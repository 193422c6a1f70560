"""The roundings there are, on the same networks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from locsnn_compile.passes.rounding.rounding import FINE, NEAREST, Rounding
from locsnn_compile.stress.cases.case import Case, lif_case, srm, srm_cases, weights

ROUNDINGS: dict[str, Rounding] = {
    "nearest": NEAREST,
    "two decays": Rounding(fitted_decays=True),
    "several formats": Rounding(graded=True),
    "together": Rounding(error_aware=True),
    "scales apart": Rounding(scaled_apart=True),
    "all of these": FINE,
    "a quarter split": replace(FINE, split=0.25),
    "all split": replace(FINE, split=1.0),
}
TIME_CONSTANTS = (10.0, 100.0)


def roundings() -> Iterator[Case]:
    """Each alone and all together, at a short and a long time constant."""
    group = "roundings"
    for name, rounding in ROUNDINGS.items():
        for tau in TIME_CONSTANTS:
            quick = tau == 100 and name in ("nearest", "all split")
            neuron, given = srm(tau_sr=tau), weights(tau)
            yield from srm_cases(group, f"{name}, tau_sr {tau:g}", neuron, given, rounding=rounding, quick=quick)
        yield lif_case(group, name, rounding=rounding)
