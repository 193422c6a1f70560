"""Thresholds and weights over twelve orders of magnitude, together and against each other."""

from __future__ import annotations

from collections.abc import Iterator

from locsnn_compile.stress.case import (
    NATIVE,
    SRM_STRATEGIES,
    THETA,
    Case,
    float_network,
    lif,
    random_input,
    srm,
    weights,
)

DECADES = range(-6, 7)
QUICK = (-6, 0, 6)


def one_scale_for_all() -> Iterator[Case]:
    """Threshold and weights alike: only their ratio reaches the chip."""
    group = "threshold and weights together"
    for decade in DECADES[::3]:
        by = 10.0**decade
        for strategy in SRM_STRATEGIES:
            network = float_network(srm(theta=THETA * by), weights() * by)
            name = f"both times 1e{decade:+d}"
            quick = decade in QUICK and strategy == "delay-line"
            yield Case(group, name, strategy, network, random_input(), quick=quick)
        network = float_network(lif(threshold=THETA * by), weights(response="leak") * by)
        yield Case(group, f"both times 1e{decade:+d}", NATIVE, network, random_input(), quick=decade in QUICK)


def weights_against_thresholds() -> Iterator[Case]:
    """Weights from a millionth to a million of what the threshold is made for."""
    group = "weights against the threshold"
    for decade in DECADES:
        by, name = 10.0**decade, f"weights times 1e{decade:+d}"
        for strategy in SRM_STRATEGIES:
            network = float_network(srm(), weights() * by)
            quick = decade in QUICK and strategy == "dendrite"
            yield Case(group, name, strategy, network, random_input(), x=by, quick=quick)
        network = float_network(lif(), weights(response="leak") * by)
        yield Case(group, name, NATIVE, network, random_input(), x=by, quick=decade in QUICK)
