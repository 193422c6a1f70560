"""Two programs on the same recordings, compared spike by spike.

The programs may be for one family of chips or for two, such as a Loihi and a Xylo.
"""

from collections.abc import Mapping
from typing import NamedTuple

from hw_model.errors import InputError
from hw_model.targets.programs import AnyProgram, kind_of
from hw_model.values import ByteArray, IntArray, Shown, Sums
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.verification.matching import PopulationMatch


class ProgramsCompared(Shown):
    """How two programs compare on the recordings of a ``source``.

    ``recordings`` is the number of recordings. In ``same_classes`` of them, both programs predict the same class, or
    neither predicts any. ``by_population`` compares the populations that both have, with the first program as
    reference.
    """

    source: str
    recordings: int
    same_classes: int
    by_population: Mapping[str, PopulationMatch]


class _Played(NamedTuple):
    """What one program does on a batch of recordings.

    ``spikes`` (batch, steps, n) by population, and the ``predictions`` (batch,): classes, or -1
    where none is predicted.
    """

    spikes: Mapping[str, ByteArray]
    predictions: IntArray


class _Batch(Sums, eq=False):
    """The comparison of a batch of recordings; the comparisons of batches can be added."""

    recordings: int
    same_classes: int
    by_population: dict[str, PopulationMatch]


def compare_programs(
    before: AnyProgram, after: AnyProgram, recordings: Recordings
) -> ProgramsCompared:
    """Play recordings to both programs, and compare their predictions and spikes.

    Raises ``InputError`` if the programs have no population in common.
    """
    total: _Batch | None = None
    for rows in batches(len(recordings)):
        spikes = recordings.spikes[rows]
        batch = _compare_batch(_play(before, spikes), _play(after, spikes))
        total = batch if total is None else total + batch
    assert total is not None  # there is at least one recording
    return ProgramsCompared(
        source=recordings.source,
        recordings=total.recordings,
        same_classes=total.same_classes,
        by_population=total.by_population,
    )


def _compare_batch(before: _Played, after: _Played) -> _Batch:
    """Compare what both programs do on the same batch."""
    common = _common_populations(before, after)
    if not common:
        what = "the programs have no population of one name, size and number of steps"
        raise InputError("--events", what, fix="Compare builds of one model, or leave it out.")
    return _Batch(
        recordings=len(before.predictions),
        same_classes=int((before.predictions == after.predictions).sum()),
        by_population={
            name: PopulationMatch.of(before.spikes[name], after.spikes[name]) for name in common
        },
    )


def _common_populations(before: _Played, after: _Played) -> list[str]:
    """Return the names of populations that have the same size and number of steps in both programs."""
    return [
        name
        for name, spikes in before.spikes.items()
        if name in after.spikes and after.spikes[name].shape == spikes.shape
    ]


def _play(program: AnyProgram, recordings: ByteArray) -> _Played:
    """Play a batch of recordings to a program; raise ``InputError`` if it has no readout."""
    if program.readout is None:
        what = "has no readout, so it predicts nothing"
        raise InputError(f"program {program.name!r}", what, fix="Compile a model.")
    result = kind_of(program).play(program, recordings, "fast")
    assert result.scores is not None  # there is a readout
    return _Played(spikes=result.spikes, predictions=program.readout.decided(result.scores))
