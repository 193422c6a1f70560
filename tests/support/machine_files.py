"""Exchange networks of SpiNNaker with a witness, and compare its registers with the simulator's.

A witness is a program other than the project's that runs the same networks: here the machine code of sPyNNaker's
neurons. Networks and results are arrays in files, see :mod:`tests.support.numbered_arrays`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from hw_model.arithmetic.spinnaker import Constants, Parameters
from hw_model.mapping.graph import Input, Phase
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.spinnaker.reference import SpinnakerResult
from tests.support import numbered_arrays
from tests.support.random_spinnaker import PHASE, Case

RECORDED = Path(__file__).parents[1] / "spinnaker/recorded-by-machine-code.npz"
"""Networks, their inputs, and the registers of the machine code; ``python -m tests.spinnaker.record_machine`` writes it."""
REGISTERS = ("fired", "recorded_v", "v", "current", "refractory")


def write_cases(path: Path, cases: Iterable[Case]) -> None:
    """Write networks of one phase with their input spikes."""
    numbered_arrays.write(path, map(_arrays_of, cases))


def _arrays_of(case: Case) -> dict[str, np.ndarray]:
    """Return a case as arrays; :func:`case_of` is the inverse."""
    network = case.network
    populations = network.populations
    arrays = {
        "populations": np.array(
            [(item.size, item.slots, item.neurons_per_core, *item.shifts) for item in populations]
        ),
        "synapses": _synapses_of(network),
        "spikes": case.spikes,
        "lateness": case.lateness,
    }
    for name in Parameters._fields:
        parts = [getattr(item.parameters, name) for item in populations]
        arrays[f"parameters.{name}"] = np.concatenate(parts)
    return arrays


def _synapses_of(network: SpinnakerNetwork) -> np.ndarray:
    """Return rows of (source, target, receptor, weight, delay), in the order in which synapses act.

    Sources count the input lines first, then the neurons; targets count the neurons. Saturation depends on the order:
    source by source, and those of one source projection by projection.
    """
    sources = network.sources_of(PHASE)
    columns = network.columns_of(PHASE)
    rows_of_projections = []
    for projection in network.projections:
        columns_of_rows = (
            sources[projection.source] + projection.source_index,
            columns[projection.target].start + projection.target_index,
            np.full(len(projection.weight), RECEPTORS.index(projection.receptor)),
            projection.weight,
            projection.delay,
        )
        rows_of_projections.append(np.column_stack(columns_of_rows))
    synapses = np.concatenate(rows_of_projections)
    return synapses[np.argsort(synapses[:, 0], kind="stable")]


def case_of(arrays: Mapping[str, np.ndarray]) -> Case:
    """Return the network that a file holds, with a projection for each source, target and receptor."""
    lines = arrays["spikes"].shape[1]
    populations = tuple(_populations_of(arrays))
    network = SpinnakerNetwork(
        phases=(Phase(PHASE, "time", steps=None),),
        inputs=(Input("lines", lines, PHASE, "touches"),),
        populations=populations,
        projections=tuple(_projections_of(arrays, lines, populations)),
    )
    return Case(network, arrays["spikes"], arrays["lateness"])


def _populations_of(arrays: Mapping[str, np.ndarray]) -> Iterable[SpinnakerPopulation]:
    """Yield the populations, whose parameters follow each other in one array per parameter."""
    first = 0
    for number, (size, slots, per_core, *shifts) in enumerate(arrays["populations"].tolist()):
        of_population = slice(first, first + size)
        parameters = {
            name: arrays[f"parameters.{name}"][of_population].astype(np.int64)
            for name in Parameters._fields
        }
        yield SpinnakerPopulation(
            name=f"cells{number}",
            phase=PHASE,
            parameters=Parameters(**parameters),
            shifts=(shifts[0], shifts[1]),
            slots=slots,
            neurons_per_core=per_core,
        )
        first += size


def _projections_of(
    arrays: Mapping[str, np.ndarray], lines: int, populations: tuple[SpinnakerPopulation, ...]
) -> Iterable[SpinnakerProjection]:
    """Yield a projection for each source, target and receptor that synapses connect, in the order of the file.

    Nodes are the lines (number 0) and the populations; node k has the numbers from ``starts[k]`` on. Targets of the
    file count neurons only, hence the addition of ``lines``.
    """
    names = ["lines", *(item.name for item in populations)]
    starts = np.cumsum([0, lines, *(item.size for item in populations)])
    synapses = arrays["synapses"].astype(np.int64)
    source, target, receptor, weight, delay = synapses.T
    source_node = np.searchsorted(starts, source, side="right") - 1
    target_node = np.searchsorted(starts, lines + target, side="right") - 1
    for from_node in range(len(names)):
        for to_node in range(1, len(names)):
            for receptor_number, receptor_name in enumerate(RECEPTORS):
                connects_nodes = (source_node == from_node) & (target_node == to_node)
                chosen = connects_nodes & (receptor == receptor_number)
                if chosen.any():
                    yield SpinnakerProjection(
                        source=names[from_node],
                        target=names[to_node],
                        receptor=receptor_name,
                        source_index=source[chosen] - starts[from_node],
                        target_index=target[chosen] + lines - starts[to_node],
                        weight=weight[chosen],
                        delay=delay[chosen],
                    )


def differences(
    case: Case, result: SpinnakerResult, witness: Mapping[str, np.ndarray]
) -> dict[str, int]:
    """Return how many values of each register, constant or count differ from the witness; names without any are left out."""
    values = {
        "fired": result.spikes,
        "recorded_v": _recorded(case, result),
        "v": result.v,
        "current": result.current,
        "refractory": result.refractory,
        "counts": np.array([result.events["late_synapses"], result.events["saturated_weights"]]),
    }
    constants = [item.constants for item in case.network.populations]
    for name in Constants._fields:
        values[name] = np.concatenate([getattr(part, name) for part in constants])
    difference_counts = {
        name: int((array != witness[name]).sum()) for name, array in values.items()
    }
    return {name: count for name, count in difference_counts.items() if count}


def values_of(witness: Mapping[str, np.ndarray]) -> int:
    """Return how many values of a witness are compared."""
    names = (*REGISTERS, *Constants._fields, "counts")
    return sum(witness[name].size for name in names)


def _recorded(case: Case, result: SpinnakerResult) -> np.ndarray:
    """Return V before each step, which is what a core records."""
    v_init = np.concatenate([item.parameters.v_init for item in case.network.populations])
    return np.concatenate([v_init[None], result.v[:-1]])
