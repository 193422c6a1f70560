"""The cases: a group for each function, whose docstring is the text about the group on the page."""

from collections.abc import Callable, Iterable
from dataclasses import replace

from locsnn_compile.stress.cases import groups
from locsnn_compile.stress.cases.case import GROUP, Case, long_runs

GROUPS: dict[str, Callable[[], Iterable[Case]]] = {
    "time constants": groups.time_constants,
    "refractory time constants": groups.refractory_time_constants,
    "decays at the ends of the grid": groups.decays,
    "threshold and weights together": groups.one_scale_for_all,
    "weights against the threshold": groups.weights_against_thresholds,
    "shapes of weights": groups.weight_shapes,
    "weight bits": groups.weight_bits,
    "roundings": groups.roundings,
    "weight exponents": groups.weight_exponents,
    "extreme floats": groups.float_extremes,
    "inputs": groups.input_patterns,
    "crowds of inputs": groups.crowds,
    "potentials at the threshold": groups.exact_thresholds,
    "refractory counts": groups.refractory_counts,
    "biases": groups.biases,
    "delays": groups.delays,
}
LEADS = {name: " ".join((made.__doc__ or "").split()) for name, made in {**GROUPS, GROUP: long_runs}.items()}
"""The text about each group of rows."""


def cases(*, quick: bool = False) -> tuple[Case, ...]:
    """Return all cases in the order of the page; if ``quick``, only those of a quick run."""
    every = (replace(case, group=group) for group, made in GROUPS.items() for case in made())
    return tuple(case for case in every if case.quick or not quick)
