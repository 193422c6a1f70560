"""Networks of SpiNNaker and what a witness says of them, as arrays by ``number/name`` in a file."""

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
from tests.support.random_spinnaker import PHASE, Case

RECORDED = Path(__file__).parents[1] / "spinnaker/recorded-by-machine-code.npz"
"""Networks, their inputs, and what the machine code did: ``python -m tests.spinnaker.record_machine`` writes it."""
REGISTERS = ("fired", "recorded_v", "v", "current", "refractory")


def write_cases(path: Path, cases: Iterable[Case]) -> None:
    """Write networks of one phase with what is played to them."""
    arrays = {}
    for number, case in enumerate(cases):
        for name, value in _arrays_of(case).items():
            arrays[f"{number}/{name}"] = value
    np.savez_compressed(path, **arrays)


def read(path: Path) -> list[dict[str, np.ndarray]]:
    """Return the arrays of a file by name, number by number."""
    parts: dict[int, dict[str, np.ndarray]] = {}
    with np.load(path) as arrays:
        for key, array in arrays.items():
            number, name = key.split("/")
            parts.setdefault(int(number), {})[name] = array
    return [parts[number] for number in sorted(parts)]


def _arrays_of(case: Case) -> dict[str, np.ndarray]:
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
    """Return synapses (source, target, receptor, weight, delay) in the order they act in."""
    sources = network.sources_of(PHASE)
    columns = network.columns_of(PHASE)
    parts = []
    for projection in network.projections:
        arrays = (
            sources[projection.source] + projection.source_index,
            columns[projection.target].start + projection.target_index,
            np.full(len(projection.weight), RECEPTORS.index(projection.receptor)),
            projection.weight,
            projection.delay,
        )
        parts.append(np.column_stack(arrays))
    synapses = np.concatenate(parts)
    return synapses[np.argsort(synapses[:, 0], kind="stable")]


def case_of(arrays: Mapping[str, np.ndarray]) -> Case:
    """Return the network that a file holds, with a projection for each source, target and receptor."""
    lines = arrays["spikes"].shape[1]
    populations = tuple(_populations_of(arrays))
    network = SpinnakerNetwork(
        phases=(Phase(PHASE, "time", None),),
        inputs=(Input("lines", lines, PHASE, "touches"),),
        populations=populations,
        projections=tuple(_projections_of(arrays, lines, populations)),
    )
    return Case(network, arrays["spikes"], arrays["lateness"])


def _populations_of(arrays: Mapping[str, np.ndarray]) -> Iterable[SpinnakerPopulation]:
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
    """Return a projection for each source node, target and receptor, in the order of the file."""
    names = ["lines", *(item.name for item in populations)]
    starts = np.cumsum([0, lines, *(item.size for item in populations)])
    synapses = arrays["synapses"].astype(np.int64)
    source, target, receptor, weight, delay = synapses.T
    source_node = np.searchsorted(starts, source, side="right") - 1
    target_node = np.searchsorted(starts, lines + target, side="right") - 1
    for node in range(len(names)):
        for onto in range(1, len(names)):
            for kind, name in enumerate(RECEPTORS):
                chosen = (source_node == node) & (target_node == onto) & (receptor == kind)
                if chosen.any():
                    yield SpinnakerProjection(
                        source=names[node],
                        target=names[onto],
                        receptor=name,
                        source_index=source[chosen] - starts[node],
                        target_index=target[chosen] + lines - starts[onto],
                        weight=weight[chosen],
                        delay=delay[chosen],
                    )


def differences(
    case: Case, result: SpinnakerResult, witness: Mapping[str, np.ndarray]
) -> dict[str, int]:
    """Return how many values of each name are not those of the witness, where any are."""
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
    counted = {name: int((array != witness[name]).sum()) for name, array in values.items()}
    return {name: count for name, count in counted.items() if count}


def values_of(witness: Mapping[str, np.ndarray]) -> int:
    """Return how many values a witness gave."""
    names = (*REGISTERS, *Constants._fields, "counts")
    return sum(witness[name].size for name in names)


def _recorded(case: Case, result: SpinnakerResult) -> np.ndarray:
    """Return V before each step, which is what a core records."""
    v_init = np.concatenate([item.parameters.v_init for item in case.network.populations])
    return np.concatenate([v_init[None], result.v[:-1]])
