"""Chips of other limits than those that ship: networks and programs work on them, or the limit that they exceed is named."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.description.chip import parse_chip
from hw_model.description.counts import COUNT_NAMES
from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import SoftCuba, SrmAlpha
from locsnn_compile.passes.srm.quantize import STRATEGIES
from locsnn_compile.settings import Setting

EXAMPLES = Path(__file__).parents[2] / "examples"
OTHER = {
    "charge_bits": 19,
    "current_bits": 20,
    "voltage_bits": 16,
    "refractory_max": 7,
    "delay_max": 10,
    "weight_bits_max": 4,
}


def chip_text(compartments=64, formats=16, **registers):
    """Return the chip file of ``loihi-sim`` with these registers."""
    document = yaml.safe_load(hw.chip("loihi-sim").document)
    document["name"] = "other"
    document["registers"] |= registers
    document["limits"] |= {
        "compartments_per_core": compartments,
        "synapse_formats_per_core": formats,
    }
    return yaml.safe_dump(document, sort_keys=False)


@cache
def network(name):
    """A network that ships with the project."""
    return lc.load(EXAMPLES / "models" / f"{name}.pt")


@pytest.fixture
def other(tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(**OTHER))
    return path


@cache
def recordings(name):
    """Return touches that ship, (samples, steps, channels), of as many steps and channels as the network has."""
    wanted = network(name)
    spikes = read_recordings(EXAMPLES / "recordings" / "touches.npz").spikes[:1]
    return wanted.fit(spikes, "touches")


def check_engines(program, spikes):
    """Both engines give the same integers."""
    probe = ("spikes", "u", "v")
    fast, slow = (
        hw.simulate(program, spikes, engine=name, probe=probe, skip=False)
        for name in ("fast", "reference")
    )
    assert fast.counts == slow.counts
    for kind in probe:
        found, wanted = getattr(fast, kind), getattr(slow, kind)
        assert all(np.array_equal(found[group], wanted[group]) for group in wanted), kind
    return fast


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["auto", *STRATEGIES])
@pytest.mark.parametrize("name", ["objects-hybrid", "containers-hybrid"])
def test_examples_compile_for_another_chip(other, name, strategy):
    """A network of kernels runs on it: every number is one that the chip holds, and no charge or current wraps."""
    compiled = lc.compile(
        network(name), target=other, strategy=strategy, events=recordings(name), diagnosis=False
    )
    chip, match = compiled.program.chip, compiled.report["match"]
    assert compiled.report["weight_bits"] == 4
    assert (
        max(form.weight_bits for core in compiled.program.cores for form in core.axons.formats) == 4
    )
    assert max(int(core.axons.delay.max(initial=0)) for core in compiled.program.cores) <= 10
    assert (
        max(profile.refractory for core in compiled.program.cores for profile in core.profiles) <= 7
    )
    assert max(core.compartments for core in compiled.program.cores) <= 64
    assert (
        max(64 * max(core.thresholds) for core in compiled.program.cores)
        < chip.registers.voltage_max
        == 65535
    )
    assert match["reference_spikes"] > 0
    assert match["spike_agreement"] > 0.3
    found = check_engines(compiled.program, recordings(name))
    assert found.counts.spikes > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strategy", "formats", "agreement"),
    [
        ("dendrite", 8, 0.98),
        ("dendrite", 5, 0.96),
        ("dendrite", 3, 0.95),
        ("delay-line", 8, 0.95),
        ("reset", 2, 0.5),
    ],
)
def test_weights_take_as_many_formats_as_a_core_holds(tmp_path, strategy, formats, agreement):
    """Signs and own spikes have formats of their own, so that three hold the published neuron: it has one grade then."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(compartments=1024, formats=formats))
    played = recordings("objects-hybrid")
    compiled = lc.compile(
        network("objects-hybrid"), target=path, strategy=strategy, events=played, diagnosis=False
    )
    assert max(len(core.axons.formats) for core in compiled.program.cores) <= formats
    assert compiled.report["match"]["spike_agreement"] > agreement
    check_engines(compiled.program, played)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["objects-hybrid-loihi", "containers-hybrid-loihi"])
@pytest.mark.parametrize(
    ("registers", "message"),
    [
        (
            {"weight_bits_max": 4},
            "synapses 'time_hidden' -> 'time_hidden/refractory': weights of 8 bits are too wide "
            "(other has weight_bits_max 4). Use narrower weights.",
        ),
        (
            {"voltage_bits": 16},
            "population 'time_hidden': its threshold is beyond every voltage, so it could never spike "
            "({} against 65535; other has voltage_bits 16). Train it for this chip.",
        ),
        ({"refractory_max": 7, "delay_max": 10}, None),
    ],
    ids=["weights", "voltage", "delays"],
)
def test_examples_of_integers(tmp_path, name, registers, message):
    """Integers are kept as they are: what this chip does not hold is named."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(**registers))
    if message is None:
        compiled = lc.compile(network(name), target=path, events=recordings(name), diagnosis=False)
        assert check_engines(compiled.program, recordings(name)).counts.spikes > 0
        return
    with pytest.raises(TargetError) as caught:
        lc.compile(network(name), target=path, events=recordings(name), diagnosis=False)
    threshold = 64 * int(network(name).populations[0].neuron.threshold[0])
    assert str(caught.value) == message.format(threshold)


def test_neurons_that_are_read_out_need_no_threshold_that_a_voltage_passes(tmp_path):
    """A quarter of what the readout is made for arrives: on a chip of half the voltage, it adds up to the same."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(voltage_bits=22))
    read = lc.Population("read", "time", 2, lc.Cuba.of(2, decay_u=0.5, decay_v=0.25, threshold=8.8))
    onto = lc.Projection("touch", "read", np.array([[1.0, 0.0], [-0.5, 0.25]]))
    readout = lc.Readout(("read",), (1.0,), potentials_from=1)
    network = lc.Network(
        "reads", 2, 40, (lc.InputView("touch", "time", 2),), (read,), (onto,), readout
    )
    played = np.zeros((1, 40, 2), dtype=np.uint8)
    played[:, ::4] = 1
    integers = lc.compile(network, events=played, diagnosis=False).levels.quantized.on_grid()
    found, wanted = (
        lc.compile(integers, target=to, events=played, diagnosis=False)
        for to in (path, "loihi-sim")
    )
    assert (
        64 * int(integers.populations[0].neuron.threshold[0])
        > found.program.chip.registers.voltage_max
    )
    assert found.report["match"]["clips"] == 0
    assert np.array_equal(*(hw.simulate(made.program, played).scores for made in (found, wanted)))


def test_a_program_written_by_hand_on_another_chip():
    chip = parse_chip(chip_text(**OTHER), "other.yaml")
    r = np.random.default_rng(0)
    b = hw.ProgramBuilder(chip)
    x = b.add_input("x", 20)
    h = b.add_compartments(
        "h", 200, decay_u=r.integers(1, 4097, 200), decay_v=r.integers(0, 4097, 200), threshold=r.integers(1, 900, 200),
        bias=64, refractory=r.integers(1, 8, 200),
    )  # fmt: skip
    o = b.add_compartments("o", 9, decay_u=0, decay_v=0, threshold=20, vmin=-1)
    b.connect(
        x,
        h,
        r.integers(-8, 8, (200, 20)) * 32,
        exponent=7,
        weight_bits=4,
        delay=r.integers(0, 11, (200, 20)),
    )
    b.connect(h, o, r.integers(-7, 8, (9, 200)) * 32)
    program = b.build()
    counts = check_engines(program, (r.random((2, 60, 20)) < 0.4).astype(np.uint8)).counts
    assert min(counts.spikes, counts.charge_wraps, counts.current_wraps, counts.voltage_clips) > 0
    assert len(program.cores) >= 4
    assert {name for name in COUNT_NAMES if not hasattr(counts, name)} == set()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight_bits": 5}, "synapses 'x' -> 'h': weights of 5 bits are too wide (other has weight_bits_max 4). Use narrower weights."),
        ({"delay": 11}, "synapses 'x' -> 'h': a delay is out of range (11 against 0..10 steps; 1 of 1 delay outside). Relay the spike through 1 compartment, or shorten the delay."),
    ],
    ids=["weights", "delays"],
)  # fmt: skip
def test_synapses_beyond_another_chip(change, message):
    b = hw.ProgramBuilder(parse_chip(chip_text(**OTHER), "other.yaml"))
    x, h = b.add_input("x", 1), b.add_compartments("h", 1, threshold=1)
    b.connect(x, h, [[32]], **change)
    with pytest.raises(TargetError) as caught:
        b.build()
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            5,
            "--weight-bits: weights of 5 bits are too wide (other has weight_bits_max 4). Ask for 4, or leave it out.",
        ),
        (
            8,
            "--weight-bits: weights of 8 bits are too wide (other has weight_bits_max 4). Ask for 4, or leave it out.",
        ),
    ],
)
def test_more_weight_bits_than_the_chip_has(other, asked, message):
    with pytest.raises(TargetError) as caught:
        lc.compile(network("objects-hybrid"), target=other, weight_bits=asked)
    assert str(caught.value) == message


@pytest.mark.slow
@pytest.mark.parametrize("delay_max", [0, 3])
def test_taps_that_a_chips_delays_do_not_hold(tmp_path, delay_max):
    """The limit is named where the strategy was asked for; ``auto`` takes another."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(delay_max=delay_max))
    with pytest.raises(TargetError) as caught:
        lc.compile(network("objects-hybrid"), target=path, strategy="delay-line", diagnosis=False)
    start, _, rest = str(caught.value).partition("(an error of ")
    tau = next(
        p.neuron.tau_ref
        for p in network("objects-hybrid").populations
        if isinstance(p.neuron, SrmAlpha)
    )
    assert start == (
        f"population 'time_hidden': {delay_max + 1} delayed synapse{'s' if delay_max else ''} cannot hold "
        f"a kernel of tau_ref {tau:g} "
    )
    assert (
        rest.partition(" ")[2]
        == f"against 0.1; other has delay_max {delay_max}). Use strategy dendrite."
    )
    compiled = lc.compile(
        network("objects-hybrid"), target=path, events=recordings("objects-hybrid"), diagnosis=False
    )
    tried = [row["strategy"] for row in compiled.report["strategy_choice"]["candidates"]]
    assert tried == ["dendrite", "reset"]


@pytest.mark.parametrize("bits", [1, 2, 3, 4, 5, 6, 8])
def test_a_drop_of_any_weight_bits(bits):
    """Two self-synapses hold what a spike takes, exactly, whatever the chip's widest weights."""
    from hw_model.arithmetic.fixed_point import weight_grid
    from locsnn_compile.network.network import Population
    from locsnn_compile.network.projections import Projection
    from locsnn_compile.passes.cuba.quantize import quantize_soft
    from locsnn_compile.passes.rounding.task import NEAREST, Task

    chip = parse_chip(chip_text(weight_bits_max=bits), "other.yaml")
    neuron = SoftCuba(
        *(np.full(5, value) for value in (0.5, 0.1, 1.0)), drop=np.linspace(0.2, 1.0, 5)
    )
    grid = weight_grid(bits, "excitatory")
    population, weights = (
        Population("n", "time", 5, neuron),
        Projection("touch", "n", np.full((5, 1), 0.5)),
    )
    made = quantize_soft(
        neuron,
        Task(population, (weights,), chip, grid, Setting("dendrite", weight_bits=8), NEAREST, None),
    ).neuron
    taps = made.refractory
    assert not grid.off_grid(np.abs(taps.mantissa)).any()
    charge = (taps.mantissa * 2.0 ** taps.exponent[:, None])[taps.delay == 0].sum(axis=0)
    assert np.array_equal(-charge, np.rint(made.threshold * neuron.drop))
