"""Recordings played to a program for a Xylo, and what is counted of them.

A Xylo hears an event of row t in row t, and everything else in this house one step later. So a
silent row comes first, and the last row of a recording, which would act after its end, is not
played: then step t of every population is step t of a network's own.
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
    """Counts of recordings: additions to currents, updates of neurons, spikes, events, saturations.

    ``extra_spikes`` are those beyond the first of a neuron in a row. The last four are those of the
    arithmetic.
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
        """Events of transposed inputs, which a Xylo has not."""
        return 0


class PlayedXylo(Frozen, eq=False):
    """What recordings (batch, steps, inputs) do.

    ``spikes`` and ``potential`` are (batch, steps, n) by population: counts, and potentials before
    the threshold is taken away. ``counts`` are those of each recording, and ``scores`` those of the
    classes (batch, classes).
    """

    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, IntArray]
    counts: tuple[XyloCounts, ...]
    scores: FloatArray


def rows_of(recording: AnyArray) -> IntArray:
    """Return the rows that a chip hears of a recording (steps, inputs): first a silent one."""
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
    spikes = by_name(program, [r.spikes for r in results], [r.output_spikes for r in results])
    potential = by_name(
        program,
        [before_spikes(network.hidden, r.v, r.spikes) for r in results],
        [before_spikes(network.outputs, r.output_v, r.output_spikes) for r in results],
    )
    return PlayedXylo(
        spikes={name: counts.astype(np.uint8) for name, counts in spikes.items()},
        potential=potential,
        counts=tuple(
            counts_of(network, of_recording, result)
            for of_recording, result in zip(rows, results, strict=True)
        ),
        scores=program.readout.scores(spikes, {}),
    )


def play_rows(network: XyloNetwork, rows: AnyArray, engine: Engine = "fast") -> XyloResult:
    """Play rows (rows, inputs) as they are; the plain engine plays where nothing can be compiled."""
    (result,) = play_all(network, [rows], engine)
    return result


def play_all(
    network: XyloNetwork, recordings: Sequence[AnyArray], engine: Engine = "fast"
) -> list[XyloResult]:
    """Play the rows (rows, inputs) of several recordings, each from rest."""
    if engine == "reference" or why_not_compiled() is not None:
        return [play_xylo(network, rows) for rows in recordings]
    from hw_model.xylo.fast import FastXylo  # numba: only where it is needed

    fast = FastXylo(network)
    return [fast.play(rows) for rows in recordings]


def by_name(
    program: XyloProgram, hidden: Sequence[IntArray], outputs: Sequence[IntArray]
) -> dict[str, IntArray]:
    """Return arrays of hidden neurons and outputs, (batch, steps, n) by population."""
    of_hidden = np.stack(hidden)
    found = {name: of_hidden[:, :, place] for name, place in program.places.items()}
    found[program.outputs] = np.stack(outputs)
    return found


def before_spikes(population: XyloPopulation, v: IntArray, spikes: IntArray) -> IntArray:
    """Return potentials (rows, n) as the threshold saw them."""
    return v + spikes * population.threshold


def counts_of(network: XyloNetwork, rows: IntArray, result: XyloResult) -> XyloCounts:
    """Return the counts of a recording that was played as ``rows``."""
    heard = np.minimum(rows, xylo.INPUT_EVENTS_MAX)
    # Spikes of the last row would act after it.
    sent = result.spikes[:-1].sum(axis=0)
    fan_in = np.count_nonzero(network.weights_in, axis=(1, 2))
    fan_out = np.count_nonzero(network.weights_hidden, axis=(1, 2))
    fan_out = fan_out + np.count_nonzero(network.weights_out, axis=1)
    neurons = network.hidden.size + network.outputs.size
    return XyloCounts(
        synaptic_ops=int(heard.sum(axis=0) @ fan_in + sent @ fan_out),
        neuron_updates=len(rows) * neurons,
        spikes=int(result.spikes.sum() + result.output_spikes.sum()),
        extra_spikes=int(np.maximum(result.spikes - 1, 0).sum()),
        input_events=int(heard.sum()),
        **result.events,
    )
