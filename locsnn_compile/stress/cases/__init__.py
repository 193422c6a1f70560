"""The cases: a group for each function, whose docstring is the text about the group on the page."""

from collections.abc import Callable, Iterable
from dataclasses import replace

from locsnn_compile.stress.cases import neurons, synapses
from locsnn_compile.stress.cases.case import GROUP, Case, long_runs

GROUPS: dict[str, Callable[[], Iterable[Case]]] = {
    "time constants": neurons.time_constants,
    "refractory time constants": neurons.refractory_time_constants,
    "decays at the ends of the grid": neurons.decays,
    "threshold and weights together": synapses.one_scale_for_all,
    "weights against the threshold": synapses.weights_against_thresholds,
    "shapes of weights": synapses.weight_shapes,
    "weight bits": synapses.weight_bits,
    "roundings": synapses.roundings,
    "weight exponents": synapses.weight_exponents,
    "extreme floats": neurons.float_extremes,
    "inputs": synapses.input_patterns,
    "crowds of inputs": synapses.crowds,
    "potentials at the threshold": neurons.exact_thresholds,
    "refractory counts": neurons.refractory_counts,
    "biases": neurons.biases,
    "delays": synapses.delays,
}
LEADS = {
    name: " ".join((made.__doc__ or "").split())
    for name, made in {**GROUPS, GROUP: long_runs}.items()
}
"""The text about each group of rows."""


def cases(*, quick: bool = False) -> tuple[Case, ...]:
    """Return all cases in the order of the page; if ``quick``, only those of a quick run."""
    every = (
        replace(case, group=group)
        for group, cases_of_group in GROUPS.items()
        for case in cases_of_group()
    )
    return tuple(case for case in every if case.quick or not quick)
