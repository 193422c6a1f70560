"""Write a program for SpiNNaker as a PyNN script, its arrays, and a recording to compare by.

Arrays of phase k have names that begin with ``k/``; of its population or projection number n, with
``k/population/n/`` and so on. Parameters are s16.15, weights and sums nA, delays steps of 1 ms.
"""

from importlib.resources import files

import numpy as np

from hw_model.arithmetic import spinnaker_inverse
from hw_model.io.files import pack_arrays
from hw_model.mapping.graph import Input
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.spinnaker.playing import PhaseRun, play_recording
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import AnyArray, ByteArray

FOLDER = "spinnaker"
PARAMETERS = (
    *("tau_m", "c_m", "v_rest", "v_reset", "v_thresh", "v_init", "i_offset", "tau_refrac"),
    "tau_syn",
)


def pynn_folder(program: SpinnakerProgram, recording: ByteArray) -> dict[str, bytes]:
    """Return the files by name, for a recording (steps, channels); equal input gives equal bytes."""
    script = (files(__package__) / "network.py.txt").read_bytes()
    runs = play_recording(program, recording)
    return {
        f"{FOLDER}/network.py": script,
        f"{FOLDER}/network.npz": pack_arrays(network_arrays(program, runs), compressed=True),
        f"{FOLDER}/expected.npz": pack_arrays(expected_arrays(program, runs), compressed=True),
    }


def network_arrays(program: SpinnakerProgram, runs: dict[str, PhaseRun]) -> dict[str, AnyArray]:
    """Return the arrays that describe the phases, their input rows among them."""
    network = program.network
    arrays: dict[str, AnyArray] = {"phases": np.array(list(runs))}
    for number, (phase, run) in enumerate(runs.items()):
        inputs = network.inputs_of(phase)
        populations = network.populations_of(phase)
        projections = network.projections_of(phase)
        sources = [*(item.name for item in inputs), *(item.name for item in populations)]
        arrays[f"{number}/steps"] = np.array(len(run.rows))
        arrays[f"{number}/inputs"] = np.array([item.name for item in inputs])
        arrays[f"{number}/populations"] = np.array([item.name for item in populations])
        arrays[f"{number}/projections"] = np.array(len(projections))
        for place, part in enumerate(_input_parts(inputs, run.rows)):
            arrays |= _named(f"{number}/input/{place}", part)
        for place, population in enumerate(populations):
            part = _population(network, population, read=population.name in _read(program))
            arrays |= _named(f"{number}/population/{place}", part)
        for place, projection in enumerate(projections):
            shifts = network.population(projection.target).shifts
            part = _projection(projection, shifts, sources)
            arrays |= _named(f"{number}/projection/{place}", part)
    return arrays


def _named(prefix: str, part: dict[str, AnyArray]) -> dict[str, AnyArray]:
    return {f"{prefix}/{name}": array for name, array in part.items()}


def _read(program: SpinnakerProgram) -> set[str]:
    """Return the populations whose potentials are read."""
    return set() if program.readout is None else set(program.readout.from_step)


def _input_parts(inputs: tuple[Input, ...], rows: ByteArray) -> list[dict[str, AnyArray]]:
    """Return size and spikes of each input, from rows (steps, lines) of all of them."""
    parts = []
    first = 0
    for item in inputs:
        step, line = np.nonzero(rows[:, first : first + item.size])
        parts.append({"size": np.array(item.size), "step": step, "line": line})
        first += item.size
    return parts


def _population(
    network: SpinnakerNetwork, population: SpinnakerPopulation, *, read: bool
) -> dict[str, AnyArray]:
    parameters = {name: getattr(population.parameters, name) for name in PARAMETERS}
    return {
        **parameters,
        "expected_sum": np.array(expected_sums(network, population)),
        "neurons_per_core": np.array(population.neurons_per_core),
        "records_v": np.array(read),
    }


def expected_sums(
    network: SpinnakerNetwork, population: SpinnakerPopulation
) -> tuple[float, float]:
    """Return M_r, by which sPyNNaker finds the shifts of a population, in nA.

    It is the largest sum of stored weights of a step. Where weights were rounded it may lie in
    another power of two; then it is a number that gives the shift.
    """
    sums = np.zeros((len(RECEPTORS), population.size))
    for projection in network.projections:
        if projection.target == population.name:
            receptor = RECEPTORS.index(projection.receptor)
            currents = spinnaker_inverse.currents_of(projection.weight, population.shifts[receptor])
            np.add.at(sums[receptor], projection.target_index, currents)
    excitatory, inhibitory = (
        _giving(shift, float(most))
        for shift, most in zip(population.shifts, sums.max(axis=1), strict=True)
    )
    return excitatory, inhibitory


def _giving(shift: int, largest_sum: float) -> float:
    if spinnaker_inverse.shift_for(largest_sum) == shift:
        return largest_sum
    return spinnaker_inverse.sum_with(shift)


def _projection(
    projection: SpinnakerProjection, shifts: tuple[int, int], sources: list[str]
) -> dict[str, AnyArray]:
    receptor = RECEPTORS.index(projection.receptor)
    ends = (sources.index(projection.source), sources.index(projection.target))
    return {
        "ends": np.array(ends),
        "receptor": np.array(projection.receptor),
        "source": projection.source_index,
        "target": projection.target_index,
        "weight": spinnaker_inverse.currents_of(projection.weight, shifts[receptor]),
        "delay": projection.delay,
    }


def expected_arrays(program: SpinnakerProgram, runs: dict[str, PhaseRun]) -> dict[str, AnyArray]:
    """Return the spikes (steps, n) of each population, and the potentials of those that are read."""
    arrays: dict[str, AnyArray] = {}
    for number, (phase, run) in enumerate(runs.items()):
        for place, (name, columns) in enumerate(program.network.columns_of(phase).items()):
            arrays[f"{number}/spikes/{place}"] = run.result.spikes[:, columns]
            if name in _read(program):
                arrays[f"{number}/potential/{place}"] = run.result.potential[:, columns]
    return arrays
