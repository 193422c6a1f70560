"""Two programs on the same recordings, spike by spike: of one arithmetic, or of two."""

from collections.abc import Mapping
from typing import NamedTuple

from hw_model.errors import InputError
from hw_model.targets.programs import AnyProgram, kind_of
from hw_model.values import ByteArray, IntArray, Shown, Sums
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.verification.matching import PopulationMatch


class ProgramsCompared(Shown):
    """What two programs do on ``recordings`` recordings of a ``source``.

    ``same_classes`` of them are predicted alike, none at all included. ``by_population`` has the
    populations of both, with the first program as the reference.
    """

    source: str
    recordings: int
    same_classes: int
    by_population: Mapping[str, PopulationMatch]


class _Played(NamedTuple):
    """Spikes (batch, steps, n) by population, and the classes that are predicted, or -1."""

    spikes: Mapping[str, ByteArray]
    decided: IntArray


class _Batch(Sums, eq=False):
    """The comparison of some recordings."""

    recordings: int
    same_classes: int
    by_population: dict[str, PopulationMatch]


def compare_programs(
    before: AnyProgram, after: AnyProgram, recordings: Recordings
) -> ProgramsCompared:
    """Play recordings to both; ``InputError`` where they have no population in common."""
    total: _Batch | None = None
    for rows in batches(len(recordings)):
        part = recordings.spikes[rows]
        batch = _compared(_play(before, part), _play(after, part))
        total = total + batch if total else batch
    assert total is not None  # there is at least one recording
    return ProgramsCompared(
        source=recordings.source,
        recordings=total.recordings,
        same_classes=total.same_classes,
        by_population=total.by_population,
    )


def _compared(before: _Played, after: _Played) -> _Batch:
    common = [
        name
        for name, spikes in before.spikes.items()
        if name in after.spikes and after.spikes[name].shape == spikes.shape
    ]
    if not common:
        what = "the programs have no population of one name, size and number of steps"
        raise InputError("--events", what, fix="Compare builds of one model, or leave it out.")
    return _Batch(
        recordings=len(before.decided),
        same_classes=int((before.decided == after.decided).sum()),
        by_population={
            name: PopulationMatch.of(before.spikes[name], after.spikes[name]) for name in common
        },
    )


def _play(program: AnyProgram, recordings: ByteArray) -> _Played:
    if program.readout is None:
        what = "has no readout, so it predicts nothing"
        raise InputError(f"program {program.name!r}", what, fix="Compile a model.")
    played = kind_of(program).play(program, recordings, "fast")
    assert played.scores is not None  # there is a readout
    return _Played(played.spikes, program.readout.decided(played.scores))
