"""A row of the table: what was measured of a case, and what is said of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from locsnn_compile.stress.bounds import Source
from locsnn_compile.stress.cases.case import Case
from locsnn_compile.verification.matching import PopulationMatch

Verdict = Literal["ok", "limited", "refused", "unexplained"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""What became of a case:

- ``ok``: no register overflowed, no number was lost, and the potential stayed within ``TENTH`` of the float one
- ``limited``: more was lost, and every cause is named with its count
- ``refused``: one line said why the chip cannot hold it, and what to do
- ``unexplained``: a crash, engines that differ, or an error beyond its bound: a defect of this project
"""
TENTH = 0.1
"""Thresholds: an error above it has its cause named."""


@dataclass(frozen=True)
class Lost:
    """Numbers other than 0 that became 0, of how many."""

    lost: int
    of: int


@dataclass(frozen=True)
class Measured:
    """How the chip compares with float64; potentials in thresholds, all samples, steps and neurons.

    ``spikes``: each side by itself. All others are of potentials that the same spikes drive, those of the float
    network: ``error`` is the largest difference, ``bound`` the largest that was derived for it, and ``parts`` what it
    is made of; ``model_error`` is what another neuron model alone does. ``otherwise`` of ``decisions`` to spike or not
    fall differently, ``ties`` of these with the float potential exactly at its threshold. ``overflowed`` potentials
    differ because a register wrapped or clipped; ``wraps`` and ``clips`` are those of the program by itself.
    ``outside``: potentials beyond the bound for no reason that is known.
    """

    spikes: PopulationMatch
    error: float
    bound: float
    parts: Mapping[Source, float]
    model_error: float
    otherwise: int
    ties: int
    decisions: int
    overflowed: int
    wraps: int
    clips: int
    weights: Lost
    biases: Lost
    coarse_decays: tuple[str, ...]
    outside: int
    odd_engine: str | None


@dataclass(frozen=True)
class Drift:
    """Of a long run, a figure for each tenth of it: spikes of both sides, and the largest error in thresholds.

    The errors are None where the neurons spike: potentials of sides whose spikes differ say nothing.
    """

    steps: int
    spikes: tuple[PopulationMatch, ...]
    error: tuple[float, ...] | None
    bound: float


@dataclass(frozen=True)
class Row:
    """A case with its verdict and the causes, each a sentence; of a refusal, the message."""

    case: Case
    verdict: Verdict
    causes: tuple[str, ...] = ()
    measured: Measured | None = None
    drift: Drift | None = field(default=None)


def by_verdict(rows: Iterable[Row]) -> dict[Verdict, int]:
    """Return how many rows have each verdict."""
    counted = Counter(row.verdict for row in rows)
    return {verdict: counted[verdict] for verdict in VERDICTS}
