"""``--emit pynn``: write a program for SpiNNaker as a PyNN script, which runs a recording on a board.

The script reads the network from arrays, plays the recording, and compares every spike with those to expect.

Arrays of phase k have names that begin with ``k/``; arrays of its input, population or projection number n begin with
``k/input/n/`` and so on. Parameters of neurons are integers in s16.15 (units of 2^-15), weights and their sums are in
nA, and delays are steps of 1 ms.

``network.py.txt`` of this folder becomes the script ``network.py``. It ends in .txt here because it imports sPyNNaker,
which is not installed with this package, so linters and the type checker must not take it for a module.
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


def pynn_folder(program: SpinnakerProgram, recording: ByteArray) -> dict[str, bytes]:
    """Return the content of the files by name, for a recording (steps, channels); equal input gives equal bytes."""
    script = (files(__package__) / "network.py.txt").read_bytes()
    runs = play_recording(program, recording)
    return {
        f"{FOLDER}/network.py": script,
        f"{FOLDER}/network.npz": pack_arrays(network_arrays(program, runs), compressed=True),
        f"{FOLDER}/expected.npz": pack_arrays(expected_arrays(program, runs), compressed=True),
    }


def network_arrays(program: SpinnakerProgram, runs: dict[str, PhaseRun]) -> dict[str, AnyArray]:
    """Return the arrays that describe the network of every phase, and the spikes of its inputs."""
    arrays: dict[str, AnyArray] = {"phases": np.array(list(runs))}
    for number, (phase, run) in enumerate(runs.items()):
        arrays |= _with_prefix(str(number), _phase_arrays(program, phase, run.rows))
    return arrays


def _with_prefix(prefix: str, arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the arrays with ``prefix/`` in front of their names."""
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def _phase_arrays(program: SpinnakerProgram, phase: str, rows: ByteArray) -> dict[str, AnyArray]:
    """Return the arrays of a phase; ``rows`` are the spikes of all its inputs, (steps, lines)."""
    network = program.network
    inputs = network.inputs_of(phase)
    populations = network.populations_of(phase)
    projections = network.projections_of(phase)
    input_names = [phase_input.name for phase_input in inputs]
    population_names = [population.name for population in populations]
    # The script numbers the ends of projections in this order.
    source_names = input_names + population_names
    arrays: dict[str, AnyArray] = {
        "steps": np.array(len(rows)),
        "inputs": np.array(input_names),
        "populations": np.array(population_names),
        "projections": np.array(len(projections)),
    }
    for number, input_arrays in enumerate(_input_arrays(inputs, rows)):
        arrays |= _with_prefix(f"input/{number}", input_arrays)
    for number, population in enumerate(populations):
        is_read = population.name in _populations_read(program)
        population_arrays = _population_arrays(network, population, is_read=is_read)
        arrays |= _with_prefix(f"population/{number}", population_arrays)
    for number, projection in enumerate(projections):
        shifts = network.population(projection.target).shifts
        projection_arrays = _projection_arrays(projection, shifts, source_names)
        arrays |= _with_prefix(f"projection/{number}", projection_arrays)
    return arrays


def _populations_read(program: SpinnakerProgram) -> set[str]:
    """Return the names of the populations whose potentials are read out."""
    if program.readout is None:
        return set()
    return set(program.readout.from_step)


def _input_arrays(inputs: tuple[Input, ...], rows: ByteArray) -> list[dict[str, AnyArray]]:
    """Return size and spikes of each input; ``rows`` (steps, lines) have the lines of all inputs side by side."""
    arrays_by_input = []
    first_line = 0
    for phase_input in inputs:
        step, line = np.nonzero(rows[:, first_line : first_line + phase_input.size])
        arrays_by_input.append({"size": np.array(phase_input.size), "step": step, "line": line})
        first_line += phase_input.size
    return arrays_by_input


def _population_arrays(
    network: SpinnakerNetwork, population: SpinnakerPopulation, *, is_read: bool
) -> dict[str, AnyArray]:
    """Return the parameters of a population in s16.15, and the settings that sPyNNaker needs.

    ``is_read``: its potentials are read out, so the script records them.
    """
    parameters = population.parameters
    return {
        "tau_m": parameters.tau_m,
        "c_m": parameters.c_m,
        "v_rest": parameters.v_rest,
        "v_reset": parameters.v_reset,
        "v_thresh": parameters.v_thresh,
        "v_init": parameters.v_init,
        "i_offset": parameters.i_offset,
        "tau_refrac": parameters.tau_refrac,
        "tau_syn": parameters.tau_syn,
        "expected_sum": np.array(expected_sums(network, population)),
        "neurons_per_core": np.array(population.neurons_per_core),
        "records_v": np.array(is_read),
    }


def expected_sums(
    network: SpinnakerNetwork, population: SpinnakerPopulation
) -> tuple[float, float]:
    """Return for each receptor the largest sum of weights in a step, in nA, as sPyNNaker is told it.

    sPyNNaker stores weights as integers of 16 bits, and scales them by a power of two, the shift, for which it needs
    this sum (M_r, see :mod:`locsnn_compile.spinnaker.own_choice`). The program already has shifts. Where weights were
    rounded, the sum of the stored ones may lie beyond another power of two, and would give another shift; then a number
    is returned that gives the shift of the program.
    """
    sums = np.zeros((len(RECEPTORS), population.size))
    for projection in network.projections:
        if projection.target == population.name:
            receptor = RECEPTORS.index(projection.receptor)
            currents = spinnaker_inverse.currents_of(projection.weight, population.shifts[receptor])
            np.add.at(sums[receptor], projection.target_index, currents)
    excitatory_sum, inhibitory_sum = sums.max(axis=1).tolist()
    excitatory_shift, inhibitory_shift = population.shifts
    return (
        _sum_for_shift(excitatory_shift, excitatory_sum),
        _sum_for_shift(inhibitory_shift, inhibitory_sum),
    )


def _sum_for_shift(shift: int, largest_sum: float) -> float:
    """Return the largest sum, in nA, if sPyNNaker derives ``shift`` from it, or else a sum from which it does."""
    if spinnaker_inverse.shift_for(largest_sum) == shift:
        return largest_sum
    return spinnaker_inverse.sum_with(shift)


def _projection_arrays(
    projection: SpinnakerProjection, shifts: tuple[int, int], source_names: list[str]
) -> dict[str, AnyArray]:
    """Return the synapses of a projection; its ends are indices in ``source_names``.

    ``shifts`` are those of its target, by receptor: stored weights are integers that they scale to nA.
    """
    source = source_names.index(projection.source)
    target = source_names.index(projection.target)
    shift = shifts[RECEPTORS.index(projection.receptor)]
    return {
        "ends": np.array((source, target)),
        "receptor": np.array(projection.receptor),
        "source": projection.source_index,
        "target": projection.target_index,
        "weight": spinnaker_inverse.currents_of(projection.weight, shift),
        "delay": projection.delay,
    }


def expected_arrays(program: SpinnakerProgram, runs: dict[str, PhaseRun]) -> dict[str, AnyArray]:
    """Return the spikes (steps, n) of each population, and the potentials of populations that are read by them."""
    populations_read = _populations_read(program)
    arrays: dict[str, AnyArray] = {}
    for phase_number, (phase, run) in enumerate(runs.items()):
        columns_by_population = program.network.columns_of(phase)
        for number, (name, columns) in enumerate(columns_by_population.items()):
            arrays[f"{phase_number}/spikes/{number}"] = run.result.spikes[:, columns]
            if name in populations_read:
                arrays[f"{phase_number}/potential/{number}"] = run.result.potential[:, columns]
    return arrays
