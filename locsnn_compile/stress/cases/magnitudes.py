"""Thresholds and weights over twelve orders of magnitude, together and against each other."""

from __future__ import annotations

from collections.abc import Iterator

from locsnn_compile.stress.cases.case import THETA, Case, lif, lif_case, srm, srm_cases, weights

DECADES = range(-6, 7)
QUICK = (-6, 0, 6)


def one_scale_for_all() -> Iterator[Case]:
    """Threshold and weights alike: only their ratio reaches the chip."""
    group = "threshold and weights together"
    for decade in DECADES[::3]:
        by, name, quick = 10.0**decade, f"both times 1e{decade:+d}", decade in QUICK
        scaled = srm(theta=THETA * by)
        yield from srm_cases(group, name, scaled, weights() * by, quick=quick, quick_as=("delay-line",))
        yield lif_case(group, name, lif(threshold=THETA * by), weights(response="leak") * by, quick=quick)


def weights_against_thresholds() -> Iterator[Case]:
    """Weights from a millionth to a million of what the threshold is made for."""
    group = "weights against the threshold"
    for decade in DECADES:
        by, name, quick = 10.0**decade, f"weights times 1e{decade:+d}", decade in QUICK
        yield from srm_cases(group, name, given=weights() * by, x=by, quick=quick)
        yield lif_case(group, name, given=weights(response="leak") * by, x=by, quick=quick)
