"""A row of the table: the measured figures of a case, its verdict and its causes, also as plain numbers for scripts."""

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
TENTH = 0.1
"""In thresholds: the cause of an error above it is named."""
_ROUNDED: dict[Source, str] = {
    "weights": "weights",
    "decays": "decays",
    "states": "truncation of states",
}
_MODELS = {
    "reset": "its reset is another neuron model",
    "delay-line": "its taps are too few for what they leave in the input's filter",
}


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

    ``spikes``, ``wraps`` and ``clips`` are those of each side by itself. For all other figures the float network's
    spikes drive both sides: ``error_thresholds`` is the largest difference of potentials, ``bound_thresholds`` the
    largest bound derived for it, and ``bound_parts_thresholds`` the parts of that; ``model_error_thresholds`` is the
    part of another neuron model. ``decisions_otherwise`` of ``decisions`` to spike differ, ``of_these_ties`` with the
    float potential exactly at the threshold. ``overflowed`` potentials differ because a register wrapped or clipped;
    ``outside`` counts potentials beyond the bound for no known reason.
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


_FOR_THE_JUDGE = ("spikes", "overflowed", "outside", "coarse_decays", "odd_engine")
"""What the document has in the causes, or as figures of the spikes."""


class Drift(Frozen):
    """Figures of a long run for each tenth of it: spikes of both sides, and the largest error in thresholds.

    Errors are None if all neurons spike: if spikes differ, the potentials cannot be compared.
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
    """Return how many rows have each verdict."""
    counted = Counter(row.verdict for row in rows)
    return {verdict: counted[verdict] for verdict in VERDICTS}


def stress_document(rows: Sequence[Row], chip: hw.Chip) -> dict[str, Any]:
    """Return what ``locsnn stress --json`` prints; errors and bounds are in thresholds."""
    found = [_row(row, chip) for row in rows]
    return {"schema": SCHEMA, "target": chip.name, "verdicts": by_verdict(rows), "rows": found}


def _row(row: Row, chip: hw.Chip) -> dict[str, Any]:
    case = row.case
    return {
        "group": case.group,
        "case": case.name,
        "strategy": case.strategy,
        "weight_bits": case.weight_bits or chip.registers.weight_bits_max,
        "verdict": row.verdict,
        "causes": list(row.causes),
        "measured": None if row.measured is None else _measured(row.measured),
        "long_run": None if row.drift is None else _drift(row.drift),
    }


def _measured(m: Measured) -> dict[str, Any]:
    return _spikes(m.spikes) | {
        key: value for key, value in asdict(m).items() if key not in _FOR_THE_JUDGE
    }


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "steps": drift.steps,
        "by_tenth": [_spikes(match) for match in drift.spikes],
        "error_thresholds_by_tenth": None if drift.error is None else list(drift.error),
        "bound_thresholds": drift.bound,
    }


def _spikes(match: PopulationMatch) -> dict[str, Any]:
    return picked(match, "reference_spikes", "chip_spikes") | {"spike_agreement": match.agreement}


def judge(case: Case, measured: Measured) -> Row:
    """Return the row of a case that the chip holds."""
    defects, causes = tuple(_defects(measured)), tuple(_causes(case, measured))
    if defects:
        return Row(case, "unexplained", defects, measured)
    return Row(case, "limited" if causes else "ok", causes, measured)


def _defects(m: Measured) -> Iterator[str]:
    if m.odd_engine:
        yield f"{m.odd_engine} differs from the fast engine"
    if m.outside:
        yield f"{plural(m.outside, 'potential')} lie beyond the bound of {short(m.bound_thresholds)} thresholds"


def _causes(case: Case, m: Measured) -> Iterator[str]:
    """Say what overflows, what is lost, and what else moves a potential by more than a tenth of a threshold."""
    if m.wraps:
        yield f"{plural(m.wraps, 'wrap')}: a charge or current leaves its register"
    if m.clips:
        yield f"{plural(m.clips, 'clip')}: the potential leaves its register"
    if m.overflowed and not (m.wraps or m.clips):
        yield f"{plural(m.overflowed, 'potential')} would leave the register with the float network's spikes"
    for these, one, many in ((m.weights, "weight", "weights"), (m.biases, "bias", "biases")):
        if these.lost:
            some = f"{count(these.lost)} of {plural(these.of, one, many)} round to 0"
            yield some if these.of > 1 else f"the only {one} rounds to 0"
    yield from m.coarse_decays
    if m.model_error_thresholds > TENTH:
        yield f"{_MODELS[case.strategy]}: {short(m.model_error_thresholds)} thresholds at most"
    elif m.error_thresholds > TENTH and not m.overflowed:
        # The sources of at least a tenth of the bound.
        large = [
            source
            for source in SOURCES
            if m.bound_parts_thresholds[source] >= TENTH * m.bound_thresholds
        ]
        parts = " and ".join(
            f"{short(m.bound_parts_thresholds[source])} by {_ROUNDED[source]}" for source in large
        )
        yield f"rounding: {short(m.error_thresholds)} thresholds found, at most {parts}"
    if m.of_these_ties:
        yield f"{plural(m.of_these_ties, 'potential')} exactly at the threshold: the least rounding decides"
