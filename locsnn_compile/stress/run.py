"""Run all cases row by row, and then the long runs, which show whether the difference of both sides grows with time.

A long run plays a block of input again and again, for up to a million steps. It is simulated at once, which keeps the
spikes and potentials of all steps, and pushed block by block to a session (``hw.Session``), which keeps only its state:
both must count the same spikes.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, groupby

import numpy as np

import hw_model as hw
from hw_model.values import BoolArray, ByteArray
from locsnn_compile.errors import LocsnnError
from locsnn_compile.network.network import Network
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.format import share, short
from locsnn_compile.stress.cases import cases
from locsnn_compile.stress.cases.case import BLOCK, POPULATION, Case, LongRun, long_runs
from locsnn_compile.stress.measure import FloatRun, Sides, lowered, measure
from locsnn_compile.stress.row import TENTH, Drift, Row, judge
from locsnn_compile.verification.matching import PopulationMatch, Progress

TENTHS = 10
"""Parts of a long run for which figures are given."""
AGREEMENT_SLACK = 0.05
"""How far the spike agreement in the last tenth may fall below the beginning without being a cause. Chosen by hand."""
ROUNDING_SLACK = 1e-6
"""Share by which an error may exceed its bound, because both are computed in float64."""
LONG_STEPS = 1_000_000
"""Steps of a long run."""
QUICK_STEPS = 10 * BLOCK
"""Steps of a long run with ``--quick``: one block for each tenth."""


def run_stress(
    chip: hw.Chip, *, quick: bool = False, progress: Progress | None = None
) -> tuple[Row, ...]:
    """Return a row for each case; ``progress`` is called with (rows done, all rows)."""
    short_cases = cases(quick=quick)
    runs = [run for run in long_runs() if run.case.quick or not quick]
    steps = QUICK_STEPS if quick else LONG_STEPS
    row_count = len(short_cases) + len(runs)
    short_rows = (run_case(case, chip) for case in short_cases)
    rows: list[Row] = []
    for row in chain(short_rows, _long_rows(runs, chip, steps)):
        rows.append(row)
        if progress:
            progress(len(rows), row_count)
    return tuple(rows)


def _long_rows(runs: Sequence[LongRun], chip: hw.Chip, steps: int) -> Iterator[Row]:
    """Yield the rows of long runs.

    Runs of one network, lowered by different strategies, follow each other: they share its float run, which takes long.
    """
    for network, runs_of_network in groupby(runs, key=lambda run: run.case.network):
        float_run: FloatRun | None = None
        for run in runs_of_network:
            if float_run is None:
                float_run = play_float(network, run.block, steps)
            yield _row_or_error(run.case, partial(long_row, run, chip, float_run))


def run_case(case: Case, chip: hw.Chip) -> Row:
    """Return the row of a case; an error gives a row as well."""
    return _row_or_error(case, lambda: judge(case, measure(case, chip)))


def _row_or_error(case: Case, judged_row: Callable[[], Row]) -> Row:
    """Return the row of a case; if computing it ends in an error, the row of the error.

    An error of ours is a refusal, if it names a way out. Warnings of numpy count as crashes: an infinity that nobody
    meant to compute leads to nonsense.
    """
    with warnings.catch_warnings(), np.errstate(over="raise", divide="raise", invalid="raise"):
        warnings.simplefilter("error", RuntimeWarning)
        try:
            return judged_row()
        except LocsnnError as error:
            if not error.fix.strip():
                return Row(case, "unexplained", (f"refused without a way out: {error}",))
            return Row(case, "refused", (str(error),))
        except Exception as error:
            return Row(case, "unexplained", (f"crash: {type(error).__name__}: {error}",))


def long_row(run: LongRun, chip: hw.Chip, float_run: FloatRun) -> Row:
    """Return the row of a long run: of its case, which plays the first blocks, and of what follows."""
    row = judge(run.case, measure(run.case, chip))
    drift, session_defect = measure_drift(run, chip, float_run)
    defects = tuple(defect for defect in (session_defect, _beyond_bound(drift)) if defect)
    if row.verdict == "unexplained":
        return replace(row, causes=row.causes + defects, drift=drift)
    if defects:
        return replace(row, verdict="unexplained", causes=defects, drift=drift)
    causes = (*row.causes, *growth(row, drift, fades=run.fades))
    return replace(row, verdict="limited" if causes else "ok", causes=causes, drift=drift)


def measure_drift(run: LongRun, chip: hw.Chip, float_run: FloatRun) -> tuple[Drift, str | None]:
    """Return figures by tenth of the run, and how a session differs from the simulation; None if it does not."""
    steps = len(float_run.spikes)
    levels = lowered(run.case, chip, steps)
    played = _repeated(run.block, steps)
    potential_probe = hw.Probe("potential", (POPULATION,))
    result = hw.simulate(levels.program, played, probe=("spikes", potential_probe))
    spikes = result.spikes[POPULATION]
    potential = result.potential[POPULATION]
    scale = levels.quantized.population(POPULATION).scale
    theta = run.case.network.populations[0].thresholds
    # Errors are taken over the neurons that spike on neither side: the potentials of others cannot be compared after
    # the first spike that differs.
    has_spikes = np.asarray(float_run.spikes.any(axis=0) | spikes.any(axis=0))
    quiet: BoolArray = ~has_spikes
    matches = []
    errors = []
    # Slices of about equal length, one after the other.
    for tenth_steps in np.array_split(np.arange(steps), TENTHS):
        tenth = slice(tenth_steps[0], tenth_steps[-1] + 1)
        matches.append(PopulationMatch.of(float_run.spikes[tenth], spikes[tenth]))
        # Tenth by tenth, because all of a long run at a time takes too much memory.
        difference = np.abs(potential[tenth] / scale - float_run.potential[tenth]) / theta
        errors.append(float(difference[:, quiet].max(initial=0.0)))
    drift = Drift(
        steps=steps,
        spikes=tuple(matches),
        error=tuple(errors) if quiet.any() else None,
        bound=drift_bound(run, chip, quiet, steps),
    )
    return drift, session_difference(levels.program, played, spikes, len(run.block))


def play_float(network: Network, block: ByteArray, steps: int) -> FloatRun:
    """Play a block (steps, channels) repeatedly to a float network; return (steps, n) in its own units."""
    recording = _repeated(block, steps)
    result = evaluate(replace(network, steps=steps), recording[None], potentials=True)
    return FloatRun(result.spikes[POPULATION][0], result.potential[POPULATION][0])


def _repeated(block: ByteArray, steps: int) -> ByteArray:
    """Return ``steps`` steps of a block (steps, channels) again and again."""
    return np.resize(block, (steps, block.shape[1]))


def drift_bound(run: LongRun, chip: hw.Chip, quiet: BoolArray, steps: int) -> float:
    """Bound the error of the ``quiet`` neurons in the whole run, in thresholds.

    The bound is computed for the beginning, which the case plays. If errors fade, it has settled there and holds for
    all time. Otherwise it grows in proportion to the steps.
    """
    if not quiet.any():
        return 0.0
    sides = Sides(lowered(run.case, chip), run.case.recordings)
    bounds_in_thresholds = (sides.model_error() + sum(sides.bound().values())) / sides.threshold
    last_block = bounds_in_thresholds[:, -len(run.block) :]
    settled_bound = float(last_block[..., quiet].max())
    if run.fades:
        return settled_bound
    return settled_bound * (steps / run.case.network.steps)


def session_difference(
    program: hw.ChipProgram, played: ByteArray, spikes: ByteArray, rows: int
) -> str | None:
    """Push the run to a session, ``rows`` rows at a time.

    Returns a sentence on where its counts of spikes first differ from those of the simulated ``spikes``; None if they
    never do.
    """
    session = hw.Session(program)
    simulated_counts = spikes.cumsum(axis=0, dtype=np.int64)
    for start in range(0, len(played), rows):
        session_counts = session.push(played[start : start + rows]).spikes[POPULATION]
        stop = start + len(session_counts)
        if not np.array_equal(session_counts[-1], simulated_counts[stop - 1]):
            return f"a session counts other spikes until step {stop}"
    return None


def _beyond_bound(drift: Drift) -> str | None:
    """Return a sentence if the largest error exceeds its bound; otherwise None."""
    largest = max(drift.error or (0.0,))
    if largest <= drift.bound * (1 + ROUNDING_SLACK):
        return None
    return f"an error of {short(largest)} thresholds in the long run is beyond the bound of {short(drift.bound)}"


def growth(row: Row, drift: Drift, *, fades: bool) -> Iterator[str]:
    """Yield a sentence for each thing that is worse in the last tenth of the run than in its beginning.

    ``fades`` is False if the neuron has no leak, so that no rounding error is ever forgotten.
    """
    assert row.measured is not None  # rows that were judged have figures
    last_error = 0.0 if drift.error is None else drift.error[-1]
    if not fades and last_error > TENTH:
        error = f"{short(last_error)} thresholds in {drift.steps:,} steps"
        yield f"nothing fades, so rounding adds up: {error}"
    first = row.measured.spikes.agreement
    last = drift.spikes[-1].agreement
    # If neither side spikes in the beginning, nothing differs there.
    beginning = 1.0 if first is None else first
    if last is not None and last < beginning - AGREEMENT_SLACK:
        equal = f"{share(first)} are equal" if first is not None else "there are none"
        yield f"spikes drift apart: {equal} in the beginning, {share(last)} in the last tenth"
