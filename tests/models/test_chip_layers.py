"""Layers that are trained on the chip's integers, against the chip's simulator and a gradient written out.

Spikes, potentials and events (wraps and clips of registers) of a layer must be those of a program that is built by hand
and played by the reference engine. The gradient must be that of the surrogate through the filters of the neuron, summed
over every path by hand.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import WEIGHT_BITS, weight_grid
from locsnn_compile.models.chip_entry import ChipNumbers, ChipPopulation, RegisterWidths
from locsnn_compile.models.chip_layers import ChipLayer
from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.settings import TRAINABLE
from tests.support.small_checkpoint import DESCRIPTION

CHIP = hw.chip("loihi-sim")
EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")


@dataclass(frozen=True)
class Synapse:
    """A synapse of a neuron to itself."""

    mantissa: int
    exponent: int
    delay: int = 0


@dataclass(frozen=True)
class Numbers:
    """The integers of a population, for any strategy; fields as in :class:`ChipPopulation`."""

    threshold: int
    decay: int
    refractory_decay: int
    refractory: int
    own: tuple[Synapse, ...]
    exponent: int
    weight_bits: int
    scale: float
    unit: float

    def population(self) -> ChipPopulation:
        """The same as the type under test."""
        own = tuple((synapse.mantissa, synapse.exponent, synapse.delay) for synapse in self.own)
        return ChipPopulation(**{**vars(self), "own": own})

    @property
    def largest(self) -> float:
        """Largest float weight that the format holds."""
        return weight_grid(self.weight_bits, "excitatory").high * self.unit


USUAL = RegisterWidths()
# The published neuron in the integers of loihi-sim. A potential of 1 is 41984.1 units of the registers, so theta, 10, is
# a threshold mantissa of 41984.1 * 10 / 64 = 6560. The decays of 390 and 2589, in 4096ths, are those of the time constants
# of 10 steps and of 1. A spike takes 205 * 2^6 * 64 units of charge from its own potential.
NUMBERS = Numbers(
    threshold=6560,
    decay=390,
    refractory_decay=2589,
    refractory=1,
    own=(Synapse(-205, 6),),
    exponent=1,
    weight_bits=8,
    scale=41984.1,
    unit=0.0125,
)


def layer_of(
    numbers: Numbers,
    strategy: str,
    weights: np.ndarray,
    neuron: NeuronParameters | None = None,
    registers: RegisterWidths = USUAL,
) -> ChipLayer:
    """The layer of torch that follows the chip's integers, with these float weights."""
    layer = ChipLayer(
        weights.shape[1],
        weights.shape[0],
        neuron or NeuronParameters(),
        numbers.population(),
        ChipNumbers("loihi-sim", strategy, registers, {}),
    )
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(weights))
    return layer


def program_of(
    numbers: Numbers, strategy: str, mantissas: np.ndarray, registers: RegisterWidths
) -> hw.ChipProgram:
    """The same population built by hand from compartments: the independent answer."""
    n, inputs = mantissas.shape
    builder = hw.ProgramBuilder(
        replace(CHIP, registers=replace(CHIP.registers, **asdict(registers)))
    )
    touch = builder.add_input("touch", inputs)
    filters = {"decay_u": numbers.decay, "decay_v": numbers.decay}
    soma_filters = {"decay_u": 4096, "decay_v": 4096, "threshold": numbers.threshold}
    if strategy == "reset":
        target = soma = builder.add_compartments(
            "out", n, **filters, threshold=numbers.threshold, refractory=numbers.refractory
        )
    else:
        soma = builder.add_compartments("out", n, **soma_filters)
        target = builder.add_compartments("out/dendrite", n, **filters, threshold=0, joined_to=soma)
    for sign, mode in ((1, "excitatory"), (-1, "inhibitory")):
        of_sign = np.where(np.sign(mantissas) == sign, mantissas, 0)
        if of_sign.any():
            builder.connect(
                touch,
                target,
                of_sign,
                exponent=numbers.exponent,
                weight_bits=numbers.weight_bits,
                sign_mode=mode,
            )
    own_target = target
    if strategy == "dendrite":
        decay = numbers.refractory_decay
        own_target = builder.add_compartments(
            "out/refractory", n, decay_u=decay, decay_v=decay, threshold=0, joined_to=soma
        )
    for synapse in numbers.own:
        if synapse.mantissa:
            mode = "excitatory" if synapse.mantissa > 0 else "inhibitory"
            weights = np.eye(n, dtype=np.int64) * synapse.mantissa
            builder.connect(
                soma,
                own_target,
                weights,
                exponent=synapse.exponent,
                delay=synapse.delay,
                sign_mode=mode,
            )
    return builder.build()


def draw_numbers(rng: np.random.Generator, strategy: str) -> Numbers:
    """Random numbers within the limits of the chip, often large ones, so that registers wrap and clip."""
    count = {"dendrite": 1, "delay-line": int(rng.integers(1, 8)), "reset": 0}[strategy]
    own = tuple(
        Synapse(int(rng.integers(-255, 256)), int(rng.integers(-8, 8)), int(rng.integers(0, 63)))
        for _ in range(count)
    )
    if strategy == "dendrite":
        own = (replace(own[0], delay=0),)
    return Numbers(
        threshold=int(2 ** rng.uniform(0, 17)) - 1,
        decay=int(rng.choice([1, 390, 2589, 4095, 4096, rng.integers(1, 4097)])),
        refractory_decay=int(rng.integers(1, 4097)),
        refractory=int(rng.choice([1, 1, 2, 5, 63])),
        own=own,
        exponent=int(rng.integers(0, 8)),
        weight_bits=int(rng.choice(WEIGHT_BITS)),
        scale=100.0,
        unit=0.01,
    )


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_a_layer_spikes_like_the_chip(strategy: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    numbers = draw_numbers(rng, strategy)
    n, inputs, steps = rng.integers(1, 6), rng.integers(1, 40), rng.integers(1, 90)
    largest = numbers.largest
    # Half of the examples have the registers of the chips that ship.
    widths = (21, 23, 23) if seed % 2 else rng.choice([9, 13, 16, 20, 29], 3).tolist()
    registers = RegisterWidths(*widths)
    layer = layer_of(
        numbers, strategy, rng.uniform(-largest, largest, size=(n, inputs)), registers=registers
    )
    x = (rng.random((2, steps, inputs)) < rng.choice([0.05, 0.5, 1.0])).astype(np.uint8)

    check_against_the_chip(layer, numbers, strategy, x)


@pytest.mark.slow
def test_the_charge_of_own_spikes_wraps_like_the_chips() -> None:
    """In the registers of the chips that ship, no single synapse makes a charge wrap; in narrower ones, it does."""
    numbers = replace(NUMBERS, threshold=100, own=(Synapse(-156, 7),))
    weights = np.array([[0.5], [1.0], [3.0]])
    layer = layer_of(numbers, "dendrite", weights, registers=RegisterWidths(charge_bits=20))
    check_against_the_chip(
        layer, numbers, "dendrite", (np.arange(60) % 7 == 0).astype(np.uint8)[None, :, None]
    )
    assert layer.events[0] > 3


def check_against_the_chip(
    layer: ChipLayer, numbers: Numbers, strategy: str, x: np.ndarray
) -> None:
    """Spikes, potentials and events are those of the program that is built by hand."""
    spikes = layer(torch.from_numpy(x).float()).detach().numpy()
    potential = layer.steps((x @ layer.mantissas().T).astype(np.float64))[1]
    simulated = hw.simulate(
        program_of(numbers, strategy, layer.mantissas(), layer.chip.registers),
        x,
        engine="reference",
        probe=("spikes", "potential"),
    )
    assert np.array_equal(spikes, simulated.spikes["out"])
    assert np.array_equal(potential, simulated.potential["out"])
    # The layer has taken its steps twice above, and counted the events of both.
    events = [sum(group[event] for group in simulated.events.values()) for event in EVENTS]
    assert layer.events.tolist() == [2 * count for count in events]


@pytest.mark.slow
def test_the_random_numbers_make_registers_wrap_and_clip_and_neurons_fire() -> None:
    """Otherwise the comparison above would not test them."""
    for strategy in TRAINABLE:
        events, spikes = np.zeros(3, dtype=np.int64), 0.0
        for seed in range(40):
            rng = np.random.default_rng(seed)
            numbers = draw_numbers(rng, strategy)
            largest = numbers.largest
            layer = layer_of(numbers, strategy, rng.uniform(-largest, largest, size=(4, 30)))
            drive = (rng.random((1, 60, 30)) < 0.5).astype(np.float64) @ layer.mantissas().T
            spikes += float(layer.steps(drive)[0].sum())
            events += layer.events
        assert (events > 0).all()
        assert spikes > 100


@pytest.mark.parametrize("bits", WEIGHT_BITS)
def test_mantissas_are_rounded_to_the_grid_of_their_format(bits: int) -> None:
    numbers = replace(NUMBERS, weight_bits=bits)
    weights = np.random.default_rng(bits).normal(0, 1.5, size=(20, 30)).astype(np.float32)
    grid = weight_grid(bits, "excitatory")
    expected = np.sign(weights) * grid.round(np.abs(weights / np.float32(numbers.unit)))
    assert np.array_equal(layer_of(numbers, "dendrite", weights).mantissas(), expected)


@pytest.mark.parametrize("strategy", TRAINABLE)
def test_the_gradient_is_that_of_the_surrogate_through_the_filters(strategy: str) -> None:
    """Summed over every path by hand: a weight acts through each input spike on all later potentials before a reset."""
    rng = np.random.default_rng(4)
    neuron = NeuronParameters(tau_rho=0.7, scale_rho=1.3)
    numbers = replace(NUMBERS, refractory=3 if strategy == "reset" else 1)
    if strategy != "dendrite":
        numbers = replace(
            numbers,
            own=(Synapse(mantissa=-200, exponent=5, delay=2),) if strategy == "delay-line" else (),
        )
    weights, steps = rng.normal(0.8, 1.0, size=(3, 5)), 40
    layer = layer_of(numbers, strategy, weights, neuron).double()
    x = torch.from_numpy((rng.random((1, steps, 5)) < 0.4).astype(np.float64)).requires_grad_()
    out = rng.normal(size=(1, steps, 3))
    (layer(x) * torch.from_numpy(out)).sum().backward()

    mantissas = layer.mantissas()
    spikes, potential, live = (a[0] for a in layer.steps(x.detach().numpy() @ mantissas.T))
    assert spikes.sum() > 5
    width = neuron.tau_rho * neuron.theta
    slope = (
        neuron.scale_rho / width * np.exp(-np.abs(potential / numbers.scale - neuron.theta) / width)
    )
    keep = (4096 - numbers.decay) / 4096  # decays are in 4096ths
    charge = 64 * 2**numbers.exponent / numbers.scale  # of a mantissa of 1, as a potential
    sent = np.zeros((steps, 3))
    for s, i in np.ndindex(steps, 3):
        u, v = charge, 0.0
        for t in range(s + 1, steps):
            v = v * keep + u
            u *= keep
            if strategy == "reset" and not live[t, i]:
                v = 0.0
            sent[s, i] += out[0, t, i] * slope[t, i] * v
            if strategy == "reset" and spikes[t, i]:
                v = 0.0
    by_weight = sent.T @ x.detach().numpy()[0] / numbers.unit
    assert layer.weight.grad is not None
    assert x.grad is not None
    # Equal but for the order of the sums in float64.
    np.testing.assert_allclose(layer.weight.grad.numpy(), by_weight, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x.grad.numpy()[0], sent @ mantissas, rtol=1e-9, atol=1e-12)


def test_weights_beyond_the_range_of_the_format_are_set_to_its_ends() -> None:
    populations = dict.fromkeys(DESCRIPTION.weight_shapes, NUMBERS.population())
    network = build_network(
        DESCRIPTION, chip=ChipNumbers("loihi-sim", "dendrite", USUAL, populations)
    )
    largest = np.float32(255 * NUMBERS.unit)
    for name in populations:
        weight = network.weight(name).detach()
        weight[0, :3] = torch.tensor([100.0, -100.0, 0.5])
        network.hold()
        assert weight[0, :3].tolist() == [largest, -largest, 0.5]
        assert network.mantissas()[name][0, :3].tolist() == [255, -255, 40]


def test_biases_of_windows_may_leave_the_range_of_weights() -> None:
    description = replace(DESCRIPTION, architecture="window-snn", neuron=None)
    populations = dict.fromkeys(description.window_names, NUMBERS.population())
    network = build_network(
        description, chip=ChipNumbers("loihi-sim", "dendrite", USUAL, populations)
    )
    for name in populations:
        network.weight(name).detach()[:] = 100.0
    network.hold()
    output, bias = (network.weight(name).detach() for name in populations)
    assert output.unique().tolist() == [np.float32(255 * NUMBERS.unit)]
    assert bias.unique().tolist() == [100.0]
