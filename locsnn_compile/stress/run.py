"""Run all cases row by row, and the long runs, which show whether the difference of both sides grows.

A long run keeps spikes and the potentials of one population. A session, which holds only a block, must count the same
spikes.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import groupby

import numpy as np

import hw_model as hw
from hw_model.values import BoolArray, ByteArray
from locsnn_compile.errors import LocsnnError
from locsnn_compile.network.network import Network
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.format import share, short
from locsnn_compile.stress.cases import cases
from locsnn_compile.stress.cases.case import BLOCK, POPULATION, Case, LongRun, long_runs
from locsnn_compile.stress.measure import Float, Sides, lowered, measure
from locsnn_compile.stress.row import TENTH, Drift, Row, judge
from locsnn_compile.verification.matching import PopulationMatch, Progress

TENTHS = 10
LESS = 0.05
"""How far the spike agreement in the last tenth of a run may fall below the beginning unnoticed."""
LONG_STEPS, QUICK_STEPS = 1_000_000, 10 * BLOCK
"""Steps of a long run, and of a long run in a quick run."""


def run_stress(
    chip: hw.Chip, *, quick: bool = False, progress: Progress | None = None
) -> tuple[Row, ...]:
    """Return a row for each case; ``progress`` is called with (rows done, all rows)."""
    table = cases(quick=quick)
    long = [run for run in long_runs() if run.case.quick or not quick]
    rows: list[Row] = []

    def done(row: Row) -> None:
        rows.append(row)
        if progress:
            progress(len(rows), len(table) + len(long))

    for case in table:
        done(run_case(case, chip))
    for network, runs in groupby(long, key=lambda run: run.case.network):
        float_run: Float | None = None
        for run in runs:
            float_run = float_run or play_float(
                network, run.block, QUICK_STEPS if quick else LONG_STEPS
            )
            done(_row(run.case, partial(long_row, run, chip, float_run)))
    return tuple(rows)


def run_case(case: Case, chip: hw.Chip) -> Row:
    """Return the row of a case, whatever happens."""
    return _row(case, lambda: judge(case, measure(case, chip)))


def _row(case: Case, make: Callable[[], Row]) -> Row:
    """Make a row; if that ends in an error, return the row of the error.

    Warnings of numpy count as crashes: an infinity that nobody meant to compute leads to nonsense.
    """
    with warnings.catch_warnings(), np.errstate(over="raise", divide="raise", invalid="raise"):
        warnings.simplefilter("error", RuntimeWarning)
        try:
            return make()
        except LocsnnError as error:
            if not error.fix.strip():
                return Row(case, "unexplained", (f"refused without a way out: {error}",))
            return Row(case, "refused", (str(error),))
        except Exception as error:
            return Row(case, "unexplained", (f"crash: {type(error).__name__}: {error}",))


def long_row(run: LongRun, chip: hw.Chip, float_run: Float) -> Row:
    """Return the row of a long run, from its beginning and from how it went on."""
    row = judge(run.case, measure(run.case, chip))
    drift, odd = measure_drift(run, chip, float_run)
    defects = tuple(defect for defect in (odd, _beyond(drift)) if defect)
    if defects or row.verdict == "unexplained":
        before = row.causes if row.verdict == "unexplained" else ()
        return replace(row, verdict="unexplained", causes=before + defects, drift=drift)
    causes = (*row.causes, *_growth(row, drift, run.fades))
    return replace(row, verdict="limited" if causes else "ok", causes=causes, drift=drift)


def measure_drift(run: LongRun, chip: hw.Chip, wanted: Float) -> tuple[Drift, str | None]:
    """Return figures by tenth of the run, and how a session differs from the simulation, if it does."""
    steps = len(wanted.spikes)
    levels = lowered(run.case, chip, steps)
    played = _repeated(run.block, steps)
    found = hw.simulate(
        levels.program, played, probe=("spikes", hw.Probe("potential", (POPULATION,)))
    )
    spikes, potential = found.spikes[POPULATION], found.potential[POPULATION]
    scale = levels.quantized.population(POPULATION).scale
    theta = run.case.network.populations[0].thresholds
    quiet: BoolArray = ~np.asarray(wanted.spikes.any(axis=0) | spikes.any(axis=0))
    parts = [slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(steps), TENTHS)]
    error = [
        float(
            (np.abs(potential[part] / scale - wanted.potential[part]) / theta)[:, quiet].max(
                initial=0.0
            )
        )
        for part in parts
    ]
    drift = Drift(
        steps,
        tuple(PopulationMatch.of(wanted.spikes[part], spikes[part]) for part in parts),
        tuple(error) if quiet.any() else None,
        _bound(run, chip, quiet, steps),
    )
    return drift, _session_differs(levels.program, played, spikes, len(run.block))


def play_float(network: Network, block: ByteArray, steps: int) -> Float:
    """Play a block (steps, channels) repeatedly to a float network; return (steps, n) in its own units."""
    found = evaluate(replace(network, steps=steps), _repeated(block, steps)[None], potentials=True)
    return Float(found.spikes[POPULATION][0], found.potential[POPULATION][0])


def _repeated(block: ByteArray, steps: int) -> ByteArray:
    return np.resize(block, (steps, block.shape[1]))


def _bound(run: LongRun, chip: hw.Chip, quiet: BoolArray, steps: int) -> float:
    """Bound the error of neurons that never spike, in thresholds; without fading, it grows as in the beginning."""
    if not quiet.any():
        return 0.0
    sides = Sides(lowered(run.case, chip), run.case.recordings)
    shares = (sides.model_error() + sum(sides.bound().values())) / sides.threshold
    settled = float(shares[:, -len(run.block) :][..., quiet].max())
    return settled * (1.0 if run.fades else steps / run.case.network.steps)


def _session_differs(
    program: hw.ChipProgram, played: ByteArray, spikes: ByteArray, rows: int
) -> str | None:
    """Push the run to a session, ``rows`` rows at a time; say where it first counts different spikes."""
    session, counted = hw.Session(program), spikes.cumsum(axis=0, dtype=np.int64)
    for start in range(0, len(played), rows):
        pushed = session.push(played[start : start + rows]).spikes[POPULATION]
        if not np.array_equal(pushed[-1], counted[start + len(pushed) - 1]):
            return f"a session counts other spikes until step {start + len(pushed)}"
    return None


def _beyond(drift: Drift) -> str | None:
    largest = max(drift.error or (0.0,))
    if largest <= drift.bound * (1 + 1e-6):
        return None
    return f"an error of {short(largest)} thresholds in the long run is beyond the bound of {short(drift.bound)}"


def _growth(row: Row, drift: Drift, fades: bool) -> Iterator[str]:
    """Say what is worse in the last tenth of the run than in its beginning."""
    assert row.measured is not None
    if not fades and drift.error is not None and drift.error[-1] > TENTH:
        yield f"nothing fades, so rounding adds up: {short(drift.error[-1])} thresholds in {drift.steps:,} steps"
    first, last = row.measured.spikes.agreement, drift.spikes[-1].agreement
    # If neither side spikes in the beginning, nothing differs there.
    if last is not None and last < (1.0 if first is None else first) - LESS:
        equal = f"{share(first)} are equal" if first is not None else "there are none"
        yield f"spikes drift apart: {equal} in the beginning, {share(last)} in the last tenth"
