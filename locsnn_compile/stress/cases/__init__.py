"""The cases, a table a theme; a group of the page is what one function gives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from locsnn_compile.stress.cases.case import Case
from locsnn_compile.stress.cases.decays import decays, refractory_time_constants, time_constants
from locsnn_compile.stress.cases.extremes import float_extremes
from locsnn_compile.stress.cases.inputs import crowds, input_patterns
from locsnn_compile.stress.cases.long_runs import GROUP
from locsnn_compile.stress.cases.thresholds import biases, exact_thresholds, refractory_counts
from locsnn_compile.stress.cases.weights import (
    delays,
    one_scale_for_all,
    roundings,
    weight_bits,
    weight_exponents,
    weight_shapes,
    weights_against_thresholds,
)

GROUPS: dict[str, Callable[[], Iterable[Case]]] = {
    "time constants": time_constants,
    "refractory time constants": refractory_time_constants,
    "decays at the ends of the grid": decays,
    "threshold and weights together": one_scale_for_all,
    "weights against the threshold": weights_against_thresholds,
    "shapes of weights": weight_shapes,
    "weight bits": weight_bits,
    "roundings": roundings,
    "weight exponents": weight_exponents,
    "extreme floats": float_extremes,
    "inputs": input_patterns,
    "crowds of inputs": crowds,
    "potentials at the threshold": exact_thresholds,
    "refractory counts": refractory_counts,
    "biases": biases,
    "delays": delays,
}
LEADS: dict[str, str] = {
    "time constants": "From half a step to more than a decay holds. The decay nearest to `exp(-1 / tau)` is within "
    "1/8192 of it, so long time constants are coarse: at 1,000 steps it has 3 bits. From about 2,000 steps the alpha "
    "kernel gains so much that all weights are less than the smallest charge.",
    "refractory time constants": "The kernel of the neuron's own spikes. `dendrite` takes what a decay holds, "
    "`delay-line` what 63 steps of delay hold, and `reset` has none.",
    "decays at the ends of the grid": "Networks that are integers already: all of the error is truncation. A decay of "
    "0 or 4096 cuts nothing.",
    "threshold and weights together": "Twelve orders of magnitude, and equal integers: only ratios reach the chip.",
    "weights against the threshold": "Twelve orders of magnitude against one threshold. Below, weights round to 0; "
    "above, a single step's charge fills its register.",
    "shapes of weights": "One exponent serves a population, so one huge weight takes the bits of all others.",
    "weight bits": "Every width of a synapse format, and 7, which none has.",
    "roundings": "Each step beyond rounding to the nearest, alone and all together; the other groups have all but "
    "splitting, as `locsnn-compile` does. Weights are rounded for recordings that are not played here.",
    "weight exponents": "Integer weights at the ends of their grid; the threshold grows with the exponent. A negative "
    "exponent takes the low bits, of the smallest weights all.",
    "extreme floats": "Denormal, infinite, not a number: refused, or counted as lost; nothing turns into nan.",
    "inputs": "Silence, single spikes, alternating, bursts and every line in every step, onto the published neuron.",
    "crowds of inputs": "All the inputs that a core has, with the largest weights there are, in every step: the charge "
    "of one step wraps, and every wrap is counted.",
    "potentials at the threshold": "Weights that add up to the threshold exactly. Where the chip holds them without "
    "rounding the rule, `>` or `>=`, is kept; elsewhere the least rounding decides, and each such decision is counted.",
    "refractory counts": "Steps that a neuron is held after a spike: the chip counts to 63.",
    "biases": "A bias of less than half a unit of the register is lost, and one of more than 4,095 thresholds is "
    "refused.",
    "delays": "Up to 62 steps.",
    GROUP: "Does rounding add up? Where potentials fade it cannot: errors of the last tenth are those of "
    "the first, below a bound for all time. Without a leak it does, as fast as derived. Potentials are compared in "
    "neurons that do not spike; the figures above the long runs are of their beginnings.",
}
"""What a group of rows shows."""


def cases(*, quick: bool = False) -> tuple[Case, ...]:
    """Return all cases in the order of the page, or those that every run has."""
    return tuple(
        replace(case, group=group) for group, made in GROUPS.items() for case in made() if case.quick or not quick
    )
