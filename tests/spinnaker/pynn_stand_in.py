"""Takes what sPyNNaker takes of a script, and plays it by the plain engine; put in the place of pyNN.spiNNaker."""
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


def setup(timestep, time_scale_factor):
    assert (timestep, time_scale_factor) == (1.0, 1)
    RUN.update(populations=[], projections=[])


class SpikeSourceArray:
    def __init__(self, spike_times):
        self.spike_times = spike_times


class IF_curr_exp:
    def __init__(self, **parameters):
        self.parameters = {name: np.asarray(each) for name, each in parameters.items()}


class Population:
    def __init__(self, size, cell, label, initial_values=None, additional_parameters=None):
        self.size, self.cell, self.label = size, cell, label
        self.v_init, self.known = initial_values, additional_parameters
        RUN["populations"].append(self)

    def set_max_atoms_per_core(self, neurons):
        self.neurons_per_core = neurons

    def record(self, variable):
        assert variable in ("spikes", "v")

    def stored(self, slots):
        assert (self.known["n_synapse_cores"], self.known["allow_delay_extensions"]) == (0, False)
        given = {
            name: np.rint(each * ONE).astype(np.int64)
            for name, each in self.cell.parameters.items()
        }
        tau_syn = np.stack([given.pop("tau_syn_E"), given.pop("tau_syn_I")], axis=1)
        v_init = np.rint(self.v_init["v"] * ONE).astype(np.int64)
        parameters = Parameters(c_m=given.pop("cm"), tau_syn=tau_syn, v_init=v_init, **given)
        shifts = tuple(map(shift_for, self.known["max_expected_summed_weight"]))
        return SpinnakerPopulation(
            self.label, "run", parameters, shifts, slots, self.neurons_per_core
        )

    def spinnaker_get_data(self, variable, as_matrix=False):
        result, columns, steps = RUN["result"], RUN["columns"][self.label], RUN["steps"]
        if variable == "v":
            assert as_matrix
            before = np.vstack([np.zeros((1, self.size)), result.v[:, columns]])
            return before[:steps] / ONE
        step, neuron = np.nonzero(result.spikes[:, columns])
        rows = np.stack([neuron, step], axis=1).astype(float)
        return rows[FAULT:]  # noqa: F821 - the test puts it above


def FromListConnector(synapses, column_names):
    assert column_names == ["weight", "delay"]
    return synapses


def StaticSynapse():
    return None


def Projection(before, after, synapses, kind, receptor_type):
    RUN["projections"].append(
        (before, after, synapses[np.argsort(synapses[:, 0], kind="stable")], receptor_type)
    )


def run(steps):
    inputs, rows = [], []
    longest = max(int(synapses[:, 3].max()) for _, _, synapses, _ in RUN["projections"])
    slots = max(2, 1 << (longest - 1).bit_length())
    for source in RUN["populations"]:
        if isinstance(source.cell, SpikeSourceArray):
            inputs.append(Input(source.label, source.size, "run", source.label))
            sent = np.zeros((steps, source.size), dtype=np.uint8)
            for line, times in enumerate(source.cell.spike_times):
                sent[np.array(times, dtype=int), line] = 1
            rows.append(sent)
    populations = [p.stored(slots) for p in RUN["populations"] if isinstance(p.cell, IF_curr_exp)]
    by_name = {population.name: population for population in populations}
    projections = []
    for before, after, synapses, receptor in RUN["projections"]:
        shift = by_name[after.label].shifts[receptor == "inhibitory"]
        whole = synapses[:, [0, 1, 3]].astype(np.int64).T
        weight = stored_weights(synapses[:, 2], shift)
        projections.append(
            SpinnakerProjection(
                before.label, after.label, receptor, whole[0], whole[1], weight, whole[2]
            )
        )
    network = SpinnakerNetwork(
        (Phase("run", "time", None),), tuple(inputs), tuple(populations), tuple(projections)
    )
    RUN["result"] = play_reference(network, "run", np.concatenate(rows, axis=1))
    RUN["columns"], RUN["steps"] = network.columns_of("run"), steps


def end():
    RUN.clear()
