"""A stand-in for ``pyNN.spiNNaker``, so that emitted scripts run without sPyNNaker and without a board.

It has the part of PyNN's interface that emitted scripts use, asserts that they use it as sPyNNaker requires, and plays
the network by our plain engine. ``test_emit_pynn.py`` writes it in the place of the package, below a line that defines
``FAULT``, the number of spikes to hide from the script.
"""
# ruff: noqa: N801, N802 - these names are PyNN's

import numpy as np

from hw_model.arithmetic.spinnaker import ONE, Parameters
from hw_model.arithmetic.spinnaker_inverse import shift_for, stored_weights
from hw_model.mapping.graph import Input, Phase
from hw_model.spinnaker.network import (
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.spinnaker.reference import play_reference

RUN = {}
"""The state between ``setup`` and ``end``: populations, projections and, after ``run``, the result."""


def setup(timestep, time_scale_factor):
    """Begin a network; a real-time step of 1 ms is the only one that scripts ask for."""
    assert (timestep, time_scale_factor) == (1.0, 1)
    RUN.update(populations=[], projections=[])


class SpikeSourceArray:
    """Input lines, with the times in ms at which each spikes."""

    def __init__(self, spike_times):
        self.spike_times = spike_times


class IF_curr_exp:
    """The parameters of neurons, in PyNN's units."""

    def __init__(self, **parameters):
        self.parameters = {name: np.asarray(values) for name, values in parameters.items()}


class Population:
    """Input lines or neurons, as ``cell`` says."""

    def __init__(self, size, cell, label, initial_values=None, additional_parameters=None):
        self.size = size
        self.cell = cell
        self.label = label
        self.initial_values = initial_values
        self.additional_parameters = additional_parameters
        RUN["populations"].append(self)

    def set_max_atoms_per_core(self, neurons):
        """Set the number of neurons per core."""
        self.neurons_per_core = neurons

    def record(self, variable):
        """Accept what sPyNNaker can record; everything is recorded here."""
        assert variable in ("spikes", "v")

    def stored(self, slots):
        """Return the population as cores store it: s16.15 parameters, and the shifts that sPyNNaker would choose."""
        options = self.additional_parameters
        assert options["n_synapse_cores"] == 0
        assert options["allow_delay_extensions"] is False
        integers = {
            name: np.rint(values * ONE).astype(np.int64)
            for name, values in self.cell.parameters.items()
        }
        tau_syn = np.stack([integers.pop("tau_syn_E"), integers.pop("tau_syn_I")], axis=1)
        v_init = np.rint(self.initial_values["v"] * ONE).astype(np.int64)
        parameters = Parameters(c_m=integers.pop("cm"), tau_syn=tau_syn, v_init=v_init, **integers)
        shifts = tuple(map(shift_for, options["max_expected_summed_weight"]))
        return SpinnakerPopulation(
            self.label, "run", parameters, shifts, slots, self.neurons_per_core
        )

    def spinnaker_get_data(self, variable, as_matrix=False):
        """Return V before each step (steps, n), or spikes as rows of a neuron and a time, without FAULT of them."""
        result = RUN["result"]
        columns = RUN["columns"][self.label]
        if variable == "v":
            assert as_matrix
            v_before = np.vstack([np.zeros((1, self.size)), result.v[:, columns]])
            return v_before[: RUN["steps"]] / ONE
        step, neuron = np.nonzero(result.spikes[:, columns])
        rows = np.stack([neuron, step], axis=1).astype(float)
        return rows[FAULT:]  # noqa: F821 - the test puts it above


def FromListConnector(synapses, column_names):
    """Return synapses as rows of a source, a target, a weight in nA and a delay in ms."""
    assert column_names == ["weight", "delay"]
    return synapses


def StaticSynapse():
    """Return nothing: a static synapse has no parameters beyond those of the connector."""


def Projection(source, target, synapses, synapse_type, receptor_type):
    """Add a projection; its synapses are sorted by source, as sPyNNaker sorts them into rows."""
    by_source = synapses[np.argsort(synapses[:, 0], kind="stable")]
    RUN["projections"].append((source, target, by_source, receptor_type))


def run(steps):
    """Play the network for this number of steps of 1 ms."""
    longest_delay = max(int(synapses[:, 3].max()) for _, _, synapses, _ in RUN["projections"])
    # The smallest power of two that holds the longest delay; 2 at least.
    slots = max(2, 1 << (longest_delay - 1).bit_length())
    inputs = []
    rows_of_inputs = []
    for source in RUN["populations"]:
        if isinstance(source.cell, SpikeSourceArray):
            inputs.append(Input(source.label, source.size, "run", source.label))
            rows = np.zeros((steps, source.size), dtype=np.uint8)
            for line, times in enumerate(source.cell.spike_times):
                rows[np.array(times, dtype=int), line] = 1
            rows_of_inputs.append(rows)
    populations = [p.stored(slots) for p in RUN["populations"] if isinstance(p.cell, IF_curr_exp)]
    network = SpinnakerNetwork(
        phases=(Phase("run", "time", steps=None),),
        inputs=tuple(inputs),
        populations=tuple(populations),
        projections=tuple(_stored_projections(populations)),
    )
    RUN["result"] = play_reference(network, "run", np.concatenate(rows_of_inputs, axis=1))
    RUN["columns"] = network.columns_of("run")
    RUN["steps"] = steps


def _stored_projections(populations):
    """Yield the projections as cores store them, with integer weights for the shift of their receptor."""
    by_name = {population.name: population for population in populations}
    for source, target, synapses, receptor in RUN["projections"]:
        excitatory_shift, inhibitory_shift = by_name[target.label].shifts
        shift = inhibitory_shift if receptor == "inhibitory" else excitatory_shift
        yield SpinnakerProjection(
            source=source.label,
            target=target.label,
            receptor=receptor,
            source_index=synapses[:, 0].astype(np.int64),
            target_index=synapses[:, 1].astype(np.int64),
            weight=stored_weights(synapses[:, 2], shift),
            delay=synapses[:, 3].astype(np.int64),
        )


def end():
    """Forget the network."""
    RUN.clear()
