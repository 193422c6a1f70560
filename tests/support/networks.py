"""Small networks for the tests, made without torch."""

import numpy as np
from scipy import sparse

import hw_model as hw
from hw_model.mapping.graph import Readout
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, matrix, values_of
from locsnn_compile.reference.evaluate import evaluate

NEURON = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
"""The published neuron: Kang et al., IJCNN 2022."""
UNIT = 64
"""Units of the chip's registers that a threshold mantissa of 1 stands for, and a weight mantissa of 1 at exponent 0."""
DECAY_OF_10 = 390
"""The decay of a time constant of 10 steps, in 4096ths that a step loses: 4096 * (1 - exp(-1 / 10)) is 389.8."""
DECAY_OF_1 = 2589
"""That of a time constant of 1 step: 4096 * (1 - exp(-1)) is 2589.2."""


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
    """A hybrid with random weights, and a walk that visits the channels backwards."""
    r = np.random.default_rng(seed)
    views = (
        InputView("touch", "time", channels),
        InputView(
            "touch_transposed",
            "location",
            together * steps,
            np.arange(channels)[::-1].copy(),
            together,
            silence,
        ),
    )
    populations, projections = [], []
    for view in views:
        names = (f"{view.axis}_hidden", f"{view.axis}_output")
        sizes = (hidden, classes)
        sources = (view.name, names[0])
        for name, size, source, fan_in in zip(
            names, sizes, sources, (view.lines, hidden), strict=True
        ):
            populations.append(Population(name, view.axis, size, neuron))
            projections.append(
                Projection(source, name, np.round(r.normal(0, scale, (size, fan_in)), 3))
            )
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
    """Random recordings (samples, steps, channels) of a network's size, with ``rate`` events per step and channel."""
    r = np.random.default_rng(seed)
    return (r.random((samples, network.steps, network.channels)) < rate).astype(np.uint8)


def check_bit_for_bit(levels, played):
    """The program has the spikes and potentials of the rounded network, whose integers the reference evaluates."""
    wanted = evaluate(levels.quantized.on_grid(), played, potentials=True)
    found = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    for population in levels.network.populations:
        assert np.array_equal(found.spikes[population.name], wanted.spikes[population.name])
        assert np.array_equal(found.potential[population.name], wanted.potential[population.name])


def single(neuron, weights=((1.0,),), *, steps=20, classes=None, recurrent=None, delay=0):
    """One population ``n`` on the time axis, behind as many input channels as its weights have columns."""
    held = matrix(weights, np.float64)
    projections = [Projection("touch", "n", held, delay)]
    if recurrent is not None:
        projections.append(Projection("n", "n", matrix(recurrent, np.float64)))
    return Network(
        name="single",
        channels=held.shape[1],
        steps=steps,
        step_seconds=None,
        sensor=None,
        views=(InputView("touch", "time", held.shape[1]),),
        populations=(Population("n", "time", held.shape[0], neuron),),
        projections=tuple(projections),
        readout=Readout(("n",), (1.0,)),
        sha256="0" * 64,
    )


def on_grid(seed, *, channels=12, steps=40, together=1, silence=0):
    """Integer populations of every kind on both axes, in random order, with loops, delays, formats and sparse weights."""
    r = np.random.default_rng(seed)
    views = (
        InputView("touch", "time", channels),
        InputView(
            "touch_transposed",
            "location",
            together * steps,
            r.permutation(channels),
            together,
            silence,
        ),
    )
    populations, projections = [], []
    for view in views:
        mine = [
            Population(f"{view.axis}_{i}", view.axis, int(size), chip_neuron(r, int(size)))
            for i, size in enumerate(r.integers(1, 5, size=3))
        ]
        populations += mine
        sizes = {view.name: view.lines, **{p.name: p.size for p in mine}}
        for target in mine:
            for source in [view.name, *r.choice([p.name for p in mine], size=r.integers(0, 3))]:
                projections.append(
                    chip_projection(r, str(source), target.name, (target.size, sizes[source]))
                )
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
    """Neurons of a random kind with random parameters, decays of 0 and 4096 among them."""
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
    taps, longest = int(r.integers(0, 6)), int(r.choice([5, 62]))
    return ChipSrm.with_taps(
        size,
        decay=decay[0],
        threshold=threshold,
        delay=r.integers(0, longest + 1, size=taps),
        mantissa=r.integers(-255, 256, size=(taps, size)),
        exponent=r.integers(-2, 8, size=taps),
    )


def chip_projection(r, source, target, shape):
    """Random mantissas on a random format's grid, a third of them 0; dense or sparse, one delay or many."""
    bits, signs = int(r.choice([1, 3, 8])), str(r.choice(["apart", "mixed"]))
    step = 1 << (9 - bits if signs == "mixed" else 8 - bits)
    low, high = (-256, 256 - step) if signs == "mixed" else (step - 256, 256 - step)
    mantissa = (
        r.integers(low // step, high // step + 1, size=shape) * step * (r.random(shape) < 0.67)
    )
    held = matrix(sparse.csr_array(mantissa) if r.random() < 0.5 else mantissa, np.int64)
    many = r.integers(0, int(r.choice([4, 63])), size=values_of(held).shape)
    delay = int(r.choice([0, 1, 7])) if r.random() < 0.5 else many
    return ChipProjection(
        source, target, held, int(r.choice([-8, -2, 0, 2, 5, 7])), bits, signs=signs, delay=delay
    )
