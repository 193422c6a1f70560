"""Find out whether wraps and clips matter: play the same program with registers wide enough that nothing overflows.

A charge or current that does not fit its register wraps, a voltage is clipped. Often no spike depends on it. If one
does, a report says so, and ``auto`` may look for another setting.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import hw_model as hw
from hw_model.program.chip_program import ChipProgram
from hw_model.program.widened import (
    WIDEST_BITS,
    has_voltage_limits,
    with_wide_registers,
    with_wide_voltages,
)
from hw_model.values import ByteArray, FloatArray, IntArray, Shown
from locsnn_compile.data.recordings import batches
from locsnn_compile.verification.matching import Match, PopulationMatch, ScoreMatch
from locsnn_compile.verification.observation import Observation, Observed

FEW_SPIKES = 0.001
"""Share of the chip's spikes up to which changed spikes are accepted: looking for another setting takes seconds. Chosen
by hand."""
NOT_WIDE_ENOUGH = f"even registers of {WIDEST_BITS} bits are too narrow"


class WideComparison(Shown):
    """What wide registers change, over the recordings in which something wrapped or was clipped.

    - ``recordings``: the number of these recordings
    - ``spikes_changed``: spikes of the network's neurons that occur with only one of the two widths
    - ``predictions_changed``: recordings whose predicted class changes
    - ``scores_change``: whether any class score changes
    - ``match``: the match with the network, over all recordings of the check, that wide registers would give
    """

    recordings: int
    spikes_changed: int
    predictions_changed: int
    scores_change: bool
    match: Match


def compare_wide(observed: Observed, match: Match) -> WideComparison | str:
    """Play the recordings in which something wrapped or was clipped again, with wide registers, and compare.

    Return :data:`NOT_WIDE_ENOUGH` if the widest registers overflow as well.
    """
    overflowing = overflowing_recordings(match)
    program = observed.levels.program
    wide = WideComparison(
        len(overflowing), spikes_changed=0, predictions_changed=0, scores_change=False, match=match
    )
    for rows in batches(len(overflowing)):
        numbers = overflowing[rows]
        recordings = observed.recordings[numbers]
        wide_chip = play_wide(program, recordings)
        if wide_chip is None:
            return NOT_WIDE_ENOUGH
        chip = hw.simulate(program, recordings)
        wide = _with_batch(wide, observed, _Batch(numbers, recordings, chip, wide_chip))
    return wide


def matters(wide: WideComparison | str) -> bool:
    """Return whether wide registers are known to change a spike or a class score."""
    if isinstance(wide, str):
        return False
    return bool(wide.spikes_changed) or wide.scores_change


def asks_for_another_setting(wide: WideComparison | str) -> bool:
    """Return whether wide registers change so much that another setting is worth looking for.

    They do if they change a prediction, more than a few spikes, or class scores without any spike (those of
    potentials).
    """
    if isinstance(wide, str) or not matters(wide):
        return False
    few = FEW_SPIKES * wide.match.spikes.chip_spikes
    only_scores_change = not wide.spikes_changed
    return bool(wide.predictions_changed) or only_scores_change or wide.spikes_changed > few


def overflowing_recordings(match: Match) -> IntArray:
    """Return the numbers of the recordings in which something wrapped or was clipped."""
    overflows = [counts.wraps + counts.clips for counts in match.counts]
    return np.flatnonzero(overflows)


def play_wide(program: ChipProgram, recordings: ByteArray) -> hw.SimulationResult | None:
    """Play recordings with registers in which nothing wraps or clips; return None if no register is wide enough.

    Wide voltages are tried first, because they usually are enough and play fastest, then all registers wide. Limits
    that the program itself sets within a register, such as floors, stay: clips at these are intended.
    """
    if not has_voltage_limits(program):
        result = hw.simulate(with_wide_voltages(program), recordings)
        if not _overflows(result):
            return result
    wide = with_wide_registers(program)
    result = hw.simulate(wide, recordings, probe=("spikes", "potential"))
    # Clips at the program's own limits are counted as well, so look at the voltages themselves.
    end = wide.chip.registers.voltage_max
    is_at_end = any(np.abs(v).max(initial=0) >= end for v in result.potential.values())
    wraps = sum(counts.wraps for counts in result.per_recording)
    return None if is_at_end or wraps else result


def _overflows(result: hw.SimulationResult) -> bool:
    """Return whether anything wrapped or was clipped."""
    return any(counts.wraps + counts.clips for counts in result.per_recording)


class _Batch(NamedTuple):
    """Recordings by their numbers, and what the program does on them with both widths."""

    numbers: IntArray
    recordings: ByteArray
    chip: hw.SimulationResult
    wide_chip: hw.SimulationResult

    @property
    def scores(self) -> FloatArray:
        """Class scores of the chip, (batch, classes)."""
        return _scores_of(self.chip)

    @property
    def wide_scores(self) -> FloatArray:
        """Class scores with wide registers, (batch, classes)."""
        return _scores_of(self.wide_chip)


def _scores_of(result: hw.SimulationResult) -> FloatArray:
    """Return the class scores, (batch, classes)."""
    assert result.scores is not None  # a network has a readout
    return result.scores


def _with_batch(wide: WideComparison, observed: Observed, batch: _Batch) -> WideComparison:
    """Return the comparison with the changes of one more batch added."""
    network = observed.network
    names = [population.name for population in network.populations if not population.helper]
    spikes_changed = sum(
        int((batch.chip.spikes[name] != batch.wide_chip.spikes[name]).sum()) for name in names
    )
    scores_change = not np.array_equal(batch.scores, batch.wide_scores)
    if not spikes_changed and not scores_change:
        return wide
    before = network.readout.decided(batch.scores)
    after = network.readout.decided(batch.wide_scores)
    return WideComparison(
        recordings=wide.recordings,
        spikes_changed=wide.spikes_changed + spikes_changed,
        predictions_changed=wide.predictions_changed + int((before != after).sum()),
        scores_change=wide.scores_change or scores_change,
        match=_corrected(wide.match, observed, batch, names),
    )


def _corrected(match: Match, observed: Observed, batch: _Batch, names: Sequence[str]) -> Match:
    """Return the match in which the results of a batch are replaced by those with wide registers."""
    quantized = observed.levels.quantized
    reference = Observation(quantized, observed.levels.program, batch.recordings).reference
    by_population = dict(match.by_population)
    for name in names:
        spikes = reference.spikes[name]
        by_population[name] = _replaced(
            by_population[name],
            PopulationMatch.of(spikes, batch.chip.spikes[name]),
            PopulationMatch.of(spikes, batch.wide_chip.spikes[name]),
        )
    scale = quantized.score_scale
    before = ScoreMatch.of(reference.scores, batch.scores / scale)
    after = ScoreMatch.of(reference.scores, batch.wide_scores / scale)
    predictions = match.chip_prediction.copy()
    predictions[batch.numbers] = observed.network.readout.decided(batch.wide_scores)
    return replace(
        match,
        chip_prediction=predictions,
        by_population=by_population,
        scores=replace(match.scores, error=match.scores.error - before.error + after.error),
    )


def _replaced(
    match: PopulationMatch, before: PopulationMatch, after: PopulationMatch
) -> PopulationMatch:
    """Return the match of all recordings after that of some recordings changed from ``before`` to ``after``."""
    return PopulationMatch(
        match.reference_spikes,
        match.chip_spikes - before.chip_spikes + after.chip_spikes,
        match.common_spikes - before.common_spikes + after.common_spikes,
    )
