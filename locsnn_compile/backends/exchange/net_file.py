"""Write a network as a ``.net`` file of lava-dl, Intel's library that trains networks for Loihi.

A network that came from such a file is written as it was. Any other must be a chain of layers, each connected to the
one before it and perhaps to itself, whose integers fit the format.
"""

import io
from typing import Any

import numpy as np

from hw_model.arithmetic import loihi
from locsnn_compile.backends.exchange.floats import HELD, may_spike
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.lava_dl.layers import Array, NetFile, NetLayer
from locsnn_compile.frontends.lava_dl.to_network import NEVER_SPIKES
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import Network
from locsnn_compile.network.projections import ChipProjection, Matrix, values_of
from locsnn_compile.network.quantized import QuantizedNetwork, QuantizedPopulation

_WHERE = "--emit net"
_OTHER = "Emit another kind."


def net_bytes(quantized: QuantizedNetwork) -> bytes:
    """Return the content of the file.

    Raise InputError for a network that is not a chain of dense layers in lava-dl's integers.
    """
    origin = quantized.network.origin
    if isinstance(origin, NetFile):
        # Its integers are already those of the chip, so nothing was rounded.
        return file_bytes(origin)
    return file_bytes(net_file(quantized))


def file_bytes(file: NetFile) -> bytes:
    """Return layers as HDF5, in the layout of lava-dl's ``export_hdf5``."""
    # A heavy import that only this emitter needs.
    import h5py

    content = io.BytesIO()
    with h5py.File(content, "w") as out:
        for layer in file.layers:
            group = out.create_group(f"layer/{layer.number}")
            # lava-dl stores the type as an array of one text of 10 bytes.
            group.create_dataset("type", (1,), "S10", [layer.kind.encode("ascii")])
            for key, value in layer.values.items():
                if key != "type":
                    group.create_dataset(key, data=value)
        for key, value in file.simulation.items():
            out.create_dataset(f"simulation/{key}", data=value)
    return content.getvalue()


def net_file(quantized: QuantizedNetwork) -> NetFile:
    """Return the layers of a chain of populations in integers."""
    network = quantized.network
    axes = {phase.axis for phase in network.phases} | {view.axis for view in network.views}
    if axes != {"time"}:
        raise InputError(_WHERE, "lava-dl has no steps along locations", fix=_OTHER)
    if len(network.views) != 1:
        measured = f"{len(network.views)} against 1"
        raise InputError(
            _WHERE,
            "lava-dl has one input",
            measured=measured,
            fix="Emit nir, or give the network one input.",
        )
    view = network.views[0]
    layers = [NetLayer(0, "input", {"shape": np.array([view.lines])})]
    layer_before = view.name
    for number, q in enumerate(quantized.populations, start=1):
        name = q.population.name
        onto = [projection for projection in quantized.projections if projection.target == name]
        sources = {projection.source for projection in onto}
        # A layer may also be connected to itself.
        if sources - {name} != {layer_before}:
            raise InputError(
                f"{_WHERE}, population {name!r}", "it is not the next layer of a chain", fix=_OTHER
            )
        # Two projections from one source have different exponents: equal ones would have been merged.
        if len(sources) < len(onto):
            raise InputError(
                f"{_WHERE}, population {name!r}", "its weights have several formats", fix=_OTHER
            )
        by_potential = name in network.readout.from_step
        layers.append(_layer(number, q, onto, by_potential=by_potential))
        layer_before = name
    _check_readout(network)
    return NetFile(tuple(layers), {})


def _check_readout(network: Network) -> None:
    """Raise InputError unless only the last layer is read out, from the step that readers of the file assume."""
    readout = network.readout
    layers = len(network.populations)
    if readout.populations != (network.populations[-1].name,):
        measured = ", ".join(readout.populations)[:80]
        raise InputError(
            f"{_WHERE}, readout", "lava-dl reads out the last layer", measured=measured, fix=HELD
        )
    # Readers of .net files count potentials from the step in which the first event can arrive, and a spike takes one
    # step per layer.
    for from_step in readout.from_step.values():
        if from_step != layers:
            what = "lava-dl counts potentials from another step"
            measured = f"{layers} against {from_step}"
            raise InputError(f"{_WHERE}, readout", what, measured=measured, fix=HELD)


def _layer(
    number: int, q: QuantizedPopulation, onto: list[ChipProjection], *, by_potential: bool
) -> NetLayer:
    """Return a layer, given the projections onto it; ``by_potential``: its potentials are read out.

    Raise InputError if lava-dl does not have its neurons, biases, weights or delays.
    """
    name = q.population.name
    neuron = q.neuron
    where = f"{_WHERE}, population {name!r}"
    if not isinstance(neuron, ChipCuba) or (neuron.refractory > 1).any():
        raise InputError(
            where,
            "lava-dl only runs neurons of one compartment without a refractory period",
            fix=_OTHER,
        )
    if by_potential and may_spike(neuron, onto):
        raise InputError(
            where, "neurons that lava-dl reads by potential never spike, and these may", fix=HELD
        )
    # lava-dl counts charge and bias in units of 64, the smallest charge of the chip.
    bias = loihi.bias_of(neuron.bias_mantissa, neuron.bias_exponent)
    bias_units = loihi.whole_units(bias)
    between_units = bias != loihi.in_registers(bias_units)
    if between_units.any():
        raise InputError(
            where,
            "a bias is not a multiple of 64",
            measured=f"{bias[between_units][0]}",
            fix=_OTHER,
        )
    threshold = neuron.threshold
    if by_potential:
        # This threshold tells a reader of the file that the potentials are read out.
        threshold = np.full_like(neuron.threshold, NEVER_SPIKES)
    values: dict[str, Array | str] = {
        "shape": np.array([q.population.size]),
        "outFeatures": np.array(q.population.size),
        "neuron/type": "CUBA",
        "neuron/iDecay": neuron.decay_u,
        "neuron/vDecay": neuron.decay_v,
        "neuron/vThMant": threshold,
        "neuron/refDelay": np.array(1),
        "neuron/gradedSpike": np.array(0),
    }
    if bias.any():
        values["bias"] = bias_units
    for projection in onto:
        is_recurrent = projection.source == name
        weights = _weights(projection, where)
        values["weight_rec" if is_recurrent else "weight"] = weights.astype(np.float32)
        if np.any(projection.delay):
            # A layer has one delay, which also delays its recurrent spikes.
            if is_recurrent or np.size(projection.delay) > 1:
                raise InputError(
                    where, "one layer cannot have several delays in lava-dl", fix=_OTHER
                )
            values["delay"] = np.array(projection.delay)
    values["inFeatures"] = np.array(np.shape(values["weight"])[1])
    kind = "dense_rec" if "weight_rec" in values else "dense"
    return NetLayer(number, kind, values)


def _weights(projection: ChipProjection, where: str) -> Any:
    """Return the weights (out, in) of a projection in units of 64.

    Raise InputError unless they are even and from -256 to 254, as lava-dl stores them.
    """
    # Sparse matrices have their values in an array of one dimension.
    mantissas: Matrix = projection.mantissa
    dense = mantissas.toarray() if values_of(mantissas).ndim == 1 else mantissas
    weights = loihi.whole_units(loihi.charge_of(dense, projection.exponent))
    if (weights % 2).any() or weights.min(initial=0) < -256 or weights.max(initial=0) > 254:
        measured = f"{weights.min()}..{weights.max()} against -256..254"
        raise InputError(
            where, "its weights are not even numbers of 8 bits", measured=measured, fix=_OTHER
        )
    return weights
