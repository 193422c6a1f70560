"""The cases of ``locsnn stress``, in groups: each group is a function that yields its cases.

The docstring of the function is the text about the group on the page that is written from the results.
"""

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
    name: " ".join((group.__doc__ or "").split())
    for name, group in {**GROUPS, GROUP: long_runs}.items()
}
"""The text about each group of rows, in one line; long runs are a group as well."""


def cases(*, quick: bool = False) -> tuple[Case, ...]:
    """Return all cases in the order of the page; if ``quick``, only those of a quick run."""
    selected: list[Case] = []
    for group, cases_of_group in GROUPS.items():
        for case_without_group in cases_of_group():
            # Whether a case is quick depends on its group.
            case = replace(case_without_group, group=group)
            if case.quick or not quick:
                selected.append(case)
    return tuple(selected)
