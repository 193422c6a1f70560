"""The cases, a table a theme; a group of the page is what one function gives."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from locsnn_compile.stress.cases.case import Case
from locsnn_compile.stress.cases.decays import decays
from locsnn_compile.stress.cases.extremes import float_extremes
from locsnn_compile.stress.cases.formats import delays, weight_bits, weight_exponents
from locsnn_compile.stress.cases.inputs import crowds, input_patterns
from locsnn_compile.stress.cases.magnitudes import one_scale_for_all, weights_against_thresholds
from locsnn_compile.stress.cases.resets import biases, refractory_counts
from locsnn_compile.stress.cases.roundings import roundings
from locsnn_compile.stress.cases.ties import exact_thresholds
from locsnn_compile.stress.cases.time_constants import refractory_time_constants, time_constants
from locsnn_compile.stress.cases.weights import weight_shapes

GROUPS: tuple[Callable[[], Iterable[Case]], ...] = (
    time_constants,
    refractory_time_constants,
    decays,
    one_scale_for_all,
    weights_against_thresholds,
    weight_shapes,
    weight_bits,
    roundings,
    weight_exponents,
    float_extremes,
    input_patterns,
    crowds,
    exact_thresholds,
    refractory_counts,
    biases,
    delays,
)


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
    "a million steps": "Does rounding add up? Where potentials fade it cannot: errors of the last tenth are those of "
    "the first, below a bound for all time. Without a leak it does, as fast as derived. Potentials are compared in "
    "neurons that do not spike; the figures above the long runs are of their beginnings.",
}
"""What a group of rows shows."""


def cases(*, quick: bool = False) -> tuple[Case, ...]:
    """Return all cases in the order of the page, or those that every run has."""
    return tuple(case for group in GROUPS for case in group() if case.quick or not quick)
