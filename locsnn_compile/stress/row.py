"""A row of the table: the measured figures of a case, its verdict and its causes, also as plain numbers for JSON.

A case is one population of neurons with extreme numbers or inputs. :func:`judge` turns what was measured into a
verdict and names what caused it.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Literal, get_args

import hw_model as hw
from hw_model.values import Frozen, picked
from locsnn_compile.report.format import count, plural, short
from locsnn_compile.stress.bounds import SOURCES, Source
from locsnn_compile.stress.cases.case import Case
from locsnn_compile.verification.matching import PopulationMatch

Verdict = Literal["ok", "limited", "refused", "unexplained"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""The outcome of a case:

- ``ok``: no register overflowed, no number was lost, and the potential stayed within ``TENTH`` of the float one
- ``limited``: more was lost, and every cause is named with its count
- ``refused``: one line says why the chip cannot hold it, and what to do
- ``unexplained``: a crash, engines that differ, or an error beyond its bound: a defect of this project
"""
SCHEMA = 1
"""The version of the JSON document."""
TENTH = 0.1
"""In thresholds: the cause of an error above it is named. Chosen by hand."""
_SOURCE_WORDS: dict[Source, str] = {
    "weights": "weights",
    "decays": "decays",
    "states": "truncation of states",
}
_MODEL_ERRORS = {
    "reset": "its reset is another neuron model",
    "delay-line": "its taps are too few for what they leave in the input's filter",
}
"""Why the neuron model of a strategy differs from the network's; those of all others are equal."""


class Lost(Frozen):
    """How many numbers other than 0 became 0, out of how many."""

    lost: int
    of: int

    @property
    def share(self) -> float:
        """The share of lost numbers."""
        return self.lost / self.of


class Measured(Frozen):
    """How the chip compares with float64 over all samples, steps and neurons; potentials are in thresholds.

    For ``spikes``, ``wraps`` and ``clips``, each side sends its own spikes. For all other figures both sides send the
    spikes of the float network:

    - ``error_thresholds``: the largest difference of potentials
    - ``bound_thresholds``: the largest bound that is derived for it
    - ``bound_parts_thresholds``: the parts of that bound by source of error
    - ``model_error_thresholds``: its part if the strategy has another neuron model
    - ``decisions``: potentials that were compared with the threshold; ``decisions_otherwise`` of them with another
      result, ``of_these_ties`` with the float potential exactly at the threshold
    - ``weights``, ``biases``: numbers that round to 0
    - ``overflowed``: potentials that differ because a register wrapped or clipped
    - ``outside``: potentials beyond the bound for no known reason
    - ``coarse_decays``: a sentence for each decay that the chip's grid changes much
    - ``odd_engine``: a way to compute the program that gives other integers; None if there is none
    """

    spikes: PopulationMatch
    error_thresholds: float
    bound_thresholds: float
    bound_parts_thresholds: Mapping[Source, float]
    model_error_thresholds: float
    decisions: int
    decisions_otherwise: int
    of_these_ties: int
    wraps: int
    clips: int
    weights: Lost
    biases: Lost
    overflowed: int
    outside: int
    coarse_decays: tuple[str, ...]
    odd_engine: str | None

    @property
    def overflows(self) -> int:
        """Wraps and clips."""
        return self.wraps + self.clips


_NOT_IN_DOCUMENT = ("spikes", "overflowed", "outside", "coarse_decays", "odd_engine")
"""Fields of ``Measured`` that the document has in another form: in the causes, or as figures of the spikes."""


class Drift(Frozen):
    """Figures of a long run for each tenth of it: spikes of both sides, and the largest error in thresholds.

    The error is that of neurons that never spike, because potentials cannot be compared once spikes differ; it is None
    if all neurons spike. ``bound`` is derived for it, in thresholds.
    """

    steps: int
    spikes: tuple[PopulationMatch, ...]
    error: tuple[float, ...] | None
    bound: float


class Row(Frozen):
    """A case with its verdict and the causes, each a sentence; for a refusal, the message."""

    case: Case
    verdict: Verdict
    causes: tuple[str, ...] = ()
    measured: Measured | None = None
    drift: Drift | None = None


def by_verdict(rows: Iterable[Row]) -> dict[Verdict, int]:
    """Return how many rows have each verdict, in the order of :data:`VERDICTS`."""
    counts = Counter(row.verdict for row in rows)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def stress_document(rows: Sequence[Row], chip: hw.Chip) -> dict[str, Any]:
    """Return what ``locsnn stress --json`` prints; errors and bounds are in thresholds."""
    return {
        "schema": SCHEMA,
        "target": chip.name,
        "verdicts": by_verdict(rows),
        "rows": [_row_document(row, chip) for row in rows],
    }


def _row_document(row: Row, chip: hw.Chip) -> dict[str, Any]:
    case = row.case
    return {
        "group": case.group,
        "case": case.name,
        "strategy": case.strategy,
        "weight_bits": case.weight_bits or chip.registers.weight_bits_max,
        "verdict": row.verdict,
        "causes": list(row.causes),
        "measured": None if row.measured is None else _measured_document(row.measured),
        "long_run": None if row.drift is None else _drift_document(row.drift),
    }


def _measured_document(measured: Measured) -> dict[str, Any]:
    document = _spikes_document(measured.spikes)
    for key, value in asdict(measured).items():
        if key not in _NOT_IN_DOCUMENT:
            document[key] = value
    return document


def _drift_document(drift: Drift) -> dict[str, Any]:
    return {
        "steps": drift.steps,
        "by_tenth": [_spikes_document(match) for match in drift.spikes],
        "error_thresholds_by_tenth": None if drift.error is None else list(drift.error),
        "bound_thresholds": drift.bound,
    }


def _spikes_document(match: PopulationMatch) -> dict[str, Any]:
    return picked(match, "reference_spikes", "chip_spikes") | {"spike_agreement": match.agreement}


def judge(case: Case, measured: Measured) -> Row:
    """Return the row of a case that the chip holds."""
    defects = tuple(_defects(measured))
    if defects:
        return Row(case, "unexplained", defects, measured)
    causes = tuple(_causes(case, measured))
    return Row(case, "limited" if causes else "ok", causes, measured)


def _defects(measured: Measured) -> Iterator[str]:
    """Yield a sentence for each thing that must not happen, whatever the case."""
    if measured.odd_engine:
        yield f"{measured.odd_engine} differs from the fast engine"
    if measured.outside:
        potentials = plural(measured.outside, "potential")
        yield f"{potentials} lie beyond the bound of {short(measured.bound_thresholds)} thresholds"


def _causes(case: Case, measured: Measured) -> Iterator[str]:
    """Yield a sentence for each limit of the chip that the case meets."""
    yield from _overflows(measured)
    yield from _lost_numbers(measured)
    yield from measured.coarse_decays
    yield from _moved_potentials(case, measured)


def _overflows(measured: Measured) -> Iterator[str]:
    """Yield a sentence on each kind of overflow."""
    if measured.wraps:
        yield f"{plural(measured.wraps, 'wrap')}: a charge or current leaves its register"
    if measured.clips:
        yield f"{plural(measured.clips, 'clip')}: the potential leaves its register"
    if measured.overflowed and not measured.overflows:
        # With its own spikes, the chip did not overflow.
        potentials = plural(measured.overflowed, "potential")
        yield f"{potentials} would leave the register with the float network's spikes"


def _lost_numbers(measured: Measured) -> Iterator[str]:
    """Yield a sentence if weights, and one if biases, round to 0."""
    kinds = ((measured.weights, "weight", "weights"), (measured.biases, "bias", "biases"))
    for numbers, singular, plural_noun in kinds:
        if numbers.lost and numbers.of == 1:
            yield f"the only {singular} rounds to 0"
        elif numbers.lost:
            all_numbers = plural(numbers.of, singular, plural_noun)
            yield f"{count(numbers.lost)} of {all_numbers} round to 0"


def _moved_potentials(case: Case, measured: Measured) -> Iterator[str]:
    """Yield what else moves a potential by more than a tenth of a threshold, and how many ties that decides."""
    if measured.model_error_thresholds > TENTH:
        model_error = short(measured.model_error_thresholds)
        yield f"{_MODEL_ERRORS[case.strategy]}: {model_error} thresholds at most"
    elif measured.error_thresholds > TENTH and not measured.overflowed:
        parts_of_bound = measured.bound_parts_thresholds
        # Sources of less than a tenth of the bound are not named.
        large_sources = [
            source
            for source in SOURCES
            if parts_of_bound[source] >= TENTH * measured.bound_thresholds
        ]
        parts = " and ".join(
            f"{short(parts_of_bound[source])} by {_SOURCE_WORDS[source]}"
            for source in large_sources
        )
        yield f"rounding: {short(measured.error_thresholds)} thresholds found, at most {parts}"
    if measured.of_these_ties:
        potentials = plural(measured.of_these_ties, "potential")
        yield f"{potentials} exactly at the threshold: the least rounding decides"
