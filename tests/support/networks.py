"""Small networks for the tests, built without torch: hybrids, single populations, and random integer networks.

A network has one or two views of its recording: the time view hears a time step per step, the location view a channel
per step, in the order of its walk.
"""

from dataclasses import replace

import numpy as np
from scipy import sparse

import hw_model as hw
from hw_model.arithmetic.fixed_point import effective_weight
from hw_model.mapping.graph import Readout
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, matrix, values_of
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate

NEURON = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
"""The published neuron: Kang et al., IJCNN 2022."""
UNIT = 64
"""Units of the chip's registers that a threshold mantissa of 1 stands for, and a weight mantissa of 1 at exponent 0."""
DECAY_OF_10 = 390
"""The decay of a time constant of 10 steps, in 4096ths that a step loses: 4096 * (1 - exp(-1 / 10)) is 389.8."""
DECAY_OF_1 = 2589
"""The decay of a time constant of 1 step: 4096 * (1 - exp(-1)) is 2589.2."""


TAU_ON_GRID = float(-1 / np.log(1 - DECAY_OF_10 / 4096))
"""The time constant, just below 10 steps, whose decay is exactly :data:`DECAY_OF_10`."""


def hybrid(
    seed=0,
    *,
    channels=4,
    steps=12,
    hidden=3,
    classes=2,
    neuron=NEURON,
    scale=8.0,
    sensor=None,
    together=1,
    silence=0,
):
    """Return a hybrid with random weights, whose walk visits the channels backwards.

    Each branch has a hidden and an output population. ``together`` channels are visited per step of the walk, and
    ``silence`` is the number of steps without events after it.
    """
    r = np.random.default_rng(seed)
    views = (
        InputView("touch", "time", channels),
        InputView(
            "touch_transposed",
            "location",
            lines=together * steps,
            walk=np.arange(channels)[::-1].copy(),
            together=together,
            silence=silence,
        ),
    )
    populations = []
    projections = []
    for view in views:
        hidden_name = f"{view.axis}_hidden"
        output_name = f"{view.axis}_output"
        layers = (
            (hidden_name, hidden, view.name, view.lines),
            (output_name, classes, hidden_name, hidden),
        )
        for name, size, source, fan_in in layers:
            weights = np.round(r.normal(0, scale, (size, fan_in)), 3)
            populations.append(Population(name, view.axis, size, neuron))
            projections.append(Projection(source, name, weights))
    return Network(
        name="small-hybrid",
        channels=channels,
        steps=steps,
        step_seconds=0.02,
        sensor=sensor,
        views=views,
        populations=tuple(populations),
        projections=tuple(projections),
        readout=Readout(("time_output", "location_output"), (1.0, 1.0)),
        sha256="0" * 64,
    )


def recordings(network, samples=3, seed=0, rate=0.3):
    """Return random recordings (samples, steps, channels) of a network's size, with ``rate`` events per step and channel."""
    r = np.random.default_rng(seed)
    return (r.random((samples, network.steps, network.channels)) < rate).astype(np.uint8)


def with_weights_of_chip(network, chip):
    """Return a network of SRM neurons with its weights replaced by their rounded values, which the chip holds exactly.

    A weight of the network times the gain of its alpha kernel and the scale of its target is the charge on the chip.
    """
    quantized = lower(network, chip, weight_bits=8).quantized
    tau = network.populations[0].neuron.tau_sr
    gain = np.e * np.exp(-1 / tau) / tau
    projections = []
    for projection, rounded in zip(network.projections, quantized.projections, strict=True):
        scale = quantized.population(projection.target).scale[:, None]
        weights = effective_weight(rounded.mantissa, rounded.exponent) / (scale * gain)
        projections.append(replace(projection, weights=weights))
    return replace(network, projections=tuple(projections))


def check_bit_for_bit(levels, played):
    """Check that a program has the spikes and potentials of the rounded network that the reference evaluates.

    ``levels`` is the result of compiling with all its intermediate levels. Return what the reference evaluates.
    """
    expected = evaluate(levels.quantized.on_grid(), played, potentials=True)
    result = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    for population in levels.network.populations:
        name = population.name
        assert np.array_equal(result.spikes[name], expected.spikes[name])
        assert np.array_equal(result.potential[name], expected.potential[name])
    return expected


def single(neuron, weights=((1.0,),), *, steps=20, classes=None, recurrent=None, delay=0):
    """Return one population ``n`` on the time axis; ``weights`` are (neurons, channels), ``recurrent`` (neurons, neurons)."""
    weights = matrix(weights, np.float64)
    projections = [Projection("touch", "n", weights, delay)]
    if recurrent is not None:
        projections.append(Projection("n", "n", matrix(recurrent, np.float64)))
    return Network(
        name="single",
        channels=weights.shape[1],
        steps=steps,
        step_seconds=None,
        sensor=None,
        views=(InputView("touch", "time", weights.shape[1]),),
        populations=(Population("n", "time", weights.shape[0], neuron),),
        projections=tuple(projections),
        readout=Readout(("n",), (1.0,)),
        sha256="0" * 64,
    )


def on_grid(seed, *, channels=12, steps=40, together=1, silence=0):
    """Return a random network in the chip's integers, with every kind of neuron on both axes.

    Populations come in random order, with loops, delays, all formats and sparse weights.
    """
    r = np.random.default_rng(seed)
    views = (
        InputView("touch", "time", channels),
        InputView(
            "touch_transposed",
            "location",
            lines=together * steps,
            walk=r.permutation(channels),
            together=together,
            silence=silence,
        ),
    )
    populations = []
    projections = []
    for view in views:
        of_view = [
            Population(f"{view.axis}_{i}", view.axis, int(size), chip_neuron(r, int(size)))
            for i, size in enumerate(r.integers(1, 5, size=3))
        ]
        populations += of_view
        sizes = {view.name: view.lines, **{p.name: p.size for p in of_view}}
        for target in of_view:
            # Every population hears its view, and up to two populations of the same axis, itself among them.
            others = r.choice([p.name for p in of_view], size=r.integers(0, 3))
            for source in [view.name, *others]:
                shape = (target.size, sizes[source])
                projections.append(chip_projection(r, str(source), target.name, shape))
    r.shuffle(populations)
    outputs = tuple(p.name for p in populations if p.name.endswith("_0"))
    return Network(
        name="on-grid",
        channels=channels,
        steps=steps,
        step_seconds=None,
        sensor=None,
        views=views,
        populations=tuple(populations),
        projections=tuple(projections),
        readout=Readout(outputs[:1], (1.0,)),
        sha256="0" * 64,
    )


def chip_neuron(r, size):
    """Return neurons of a random kind: with a current (CUBA), SRM with a refractory dendrite, or SRM with delay lines.

    Decays of 0 and 4096 are among their parameters.
    """
    decay = r.choice([0, 1, DECAY_OF_10, DECAY_OF_1, 4095, 4096], size=4)
    threshold = r.integers(0, 300, size=size)
    kind = r.integers(3)
    if kind == 0:
        return ChipCuba.of(
            size,
            decay_u=r.integers(0, 4097, size=size),
            decay_v=decay[1],
            threshold=threshold,
            bias_mantissa=r.integers(-300, 300, size=size),
            bias_exponent=r.integers(0, 8, size=size),
            refractory=r.integers(1, 6, size=size),
        )
    if kind == 1:
        return ChipSrm.with_taps(
            size,
            decay=decay[0],
            threshold=threshold,
            refractory_decay=decay[1],
            mantissa=r.integers(-255, 1, size=(1, size)),
            exponent=int(r.integers(-2, 8)),
        )
    taps = int(r.integers(0, 6))  # synapses by which own spikes come back
    longest = int(r.choice([5, 62]))
    return ChipSrm.with_taps(
        size,
        decay=decay[0],
        threshold=threshold,
        delay=r.integers(0, longest + 1, size=taps),
        mantissa=r.integers(-255, 256, size=(taps, size)),
        exponent=r.integers(-2, 8, size=taps),
    )


def chip_projection(r, source, target, shape):
    """Return synapses with random mantissas on the grid of a random format, a third of them 0.

    Weights are dense or sparse, and have one delay or one each. Signs are ``mixed`` in one format, or kept ``apart`` in
    an excitatory and an inhibitory one, whose grid is twice as fine.
    """
    bits = int(r.choice([1, 3, 8]))
    signs = str(r.choice(["apart", "mixed"]))
    if signs == "mixed":
        step = 1 << (9 - bits)
        low = -256
    else:
        step = 1 << (8 - bits)
        low = step - 256
    high = 256 - step
    mantissa = r.integers(low // step, high // step + 1, size=shape) * step
    mantissa *= r.random(shape) < 0.67
    if r.random() < 0.5:
        mantissa = sparse.csr_array(mantissa)
    weights = matrix(mantissa, np.int64)
    delay_of_each = r.integers(0, int(r.choice([4, 63])), size=values_of(weights).shape)
    delay = int(r.choice([0, 1, 7])) if r.random() < 0.5 else delay_of_each
    exponent = int(r.choice([-8, -2, 0, 2, 5, 7]))
    return ChipProjection(
        source, target, weights, exponent, weight_bits=bits, signs=signs, delay=delay
    )
