"""Play recordings to a program for a Xylo, and count operations for the report.

On a Xylo, an input event of row t acts in row t; in trained networks and on all other chips of this project, it acts in
step t + 1. So recordings are shifted by one row: a silent row comes first, and the last row, which would act after the
end, is not played. Then step t on the chip is step t of the network.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.engine.usable import why_not_compiled
from hw_model.errors import InputError
from hw_model.values import AnyArray, ByteArray, FloatArray, Frozen, IntArray, Sums
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.program import XyloProgram
from hw_model.xylo.reference import XyloResult, play_xylo

Engine = Literal["fast", "reference"]


class XyloCounts(Sums):
    """How often everything happened in a recording, or in several.

    ``synaptic_ops`` is additions to currents; ``extra_spikes`` is the spikes beyond the first of a neuron in a row. The
    last four are the arithmetic's :data:`hw_model.arithmetic.xylo.EVENTS`.
    """

    synaptic_ops: int = 0
    neuron_updates: int = 0
    spikes: int = 0
    extra_spikes: int = 0
    input_events: int = 0
    current_saturations: int = 0
    change_saturations: int = 0
    potential_saturations: int = 0
    lost_input_events: int = 0

    @property
    def saturations(self) -> int:
        """How often anything saturated."""
        return self.current_saturations + self.change_saturations + self.potential_saturations

    @property
    def transpose_events(self) -> int:
        """Events through a transpose buffer, which a Xylo does not have; reports ask it of all chips."""
        return 0


class PlayedXylo(Frozen, eq=False):
    """What a program did on a batch of recordings (batch, steps, inputs).

    - ``spikes``: the number of spikes, (batch, steps, n) by population
    - ``potential``: potentials before spikes subtract the threshold, (batch, steps, n) by population
    - ``counts``: the counts of each recording
    - ``scores``: the class scores (batch, classes)
    """

    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, IntArray]
    counts: tuple[XyloCounts, ...]
    scores: FloatArray


def rows_of(recording: AnyArray) -> IntArray:
    """Return the rows to play to the chip for a recording (steps, inputs): shifted by one, with a silent row first."""
    rows = np.zeros(recording.shape, dtype=np.int64)
    rows[1:] = recording[:-1]
    return rows


def play_program(program: XyloProgram, recordings: AnyArray, engine: Engine = "fast") -> PlayedXylo:
    """Play recordings (batch, steps, inputs) of counts, each from rest; engines give equal results."""
    batch = np.asarray(recordings)
    if batch.ndim != 3 or batch.shape[2] != program.inputs:
        measured = f"{batch.shape} against (batch, steps, {program.inputs})"
        fix = "Give recordings of its inputs."
        raise InputError(f"program {program.name!r}", "they do not fit", measured=measured, fix=fix)
    network = program.network
    rows = [rows_of(recording) for recording in batch]
    results = play_all(network, rows, engine)
    spikes = by_name(
        program,
        hidden=[result.spikes for result in results],
        outputs=[result.output_spikes for result in results],
    )
    potential = by_name(
        program,
        hidden=[before_spikes(network.hidden, r.v, r.spikes) for r in results],
        outputs=[before_spikes(network.outputs, r.output_v, r.output_spikes) for r in results],
    )
    counts = [
        counts_of(network, rows_of_recording, result)
        for rows_of_recording, result in zip(rows, results, strict=True)
    ]
    return PlayedXylo(
        # A neuron sends at most 31 spikes in a row, so bytes are enough.
        spikes={name: array.astype(np.uint8) for name, array in spikes.items()},
        potential=potential,
        counts=tuple(counts),
        scores=program.readout.scores(spikes, {}),
    )


def play_rows(network: XyloNetwork, rows: AnyArray, engine: Engine = "fast") -> XyloResult:
    """Play rows (rows, inputs) as they are, without the shift of :func:`rows_of`."""
    (result,) = play_all(network, [rows], engine)
    return result


def play_all(
    network: XyloNetwork, recordings: Sequence[AnyArray], engine: Engine = "fast"
) -> list[XyloResult]:
    """Play the rows (rows, inputs) of several recordings, each from rest. Without numba, the plain engine plays."""
    if engine == "reference" or why_not_compiled() is not None:
        return [play_xylo(network, rows) for rows in recordings]
    # Imported here, because it imports numba, which takes long and may be missing.
    from hw_model.xylo.fast import FastXylo

    fast = FastXylo(network)
    return [fast.play(rows) for rows in recordings]


def by_name(
    program: XyloProgram, hidden: Sequence[IntArray], outputs: Sequence[IntArray]
) -> dict[str, IntArray]:
    """Return arrays (steps, neurons) of several recordings as (batch, steps, n) by the names of populations.

    On the chip all hidden neurons are one population; the program's names divide it again.
    """
    of_hidden = np.stack(hidden)
    by_population = {name: of_hidden[:, :, place] for name, place in program.places.items()}
    by_population[program.outputs] = np.stack(outputs)
    return by_population


def before_spikes(population: XyloPopulation, v: IntArray, spikes: IntArray) -> IntArray:
    """Return potentials (rows, n) as they were compared with the threshold, from those after the spikes.

    Every spike subtracts the threshold once.
    """
    return v + spikes * population.threshold


def counts_of(network: XyloNetwork, rows: IntArray, result: XyloResult) -> XyloCounts:
    """Return the counts of a recording that was played as ``rows``."""
    # An input line takes at most 15 events of a row; the rest is lost.
    input_events = np.minimum(rows, xylo.INPUT_EVENTS_MAX)
    # Spikes act in the next row, so those of the last row reach no synapse.
    acting_spikes = result.spikes[:-1].sum(axis=0)
    synapses_of_input = np.count_nonzero(network.weights_in, axis=(1, 2))
    synapses_of_hidden = np.count_nonzero(network.weights_hidden, axis=(1, 2))
    synapses_of_hidden = synapses_of_hidden + np.count_nonzero(network.weights_out, axis=1)
    input_ops = input_events.sum(axis=0) @ synapses_of_input
    neurons = network.hidden.size + network.outputs.size
    return XyloCounts(
        synaptic_ops=int(input_ops + acting_spikes @ synapses_of_hidden),
        neuron_updates=len(rows) * neurons,
        spikes=int(result.spikes.sum() + result.output_spikes.sum()),
        extra_spikes=int(np.maximum(result.spikes - 1, 0).sum()),
        input_events=int(input_events.sum()),
        **result.events,
    )
