"""Chips with other limits than those that ship: networks compile for them, or the error names the limit that is exceeded."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.description.chip import parse_chip
from hw_model.description.counts import COUNT_NAMES
from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import SoftCuba
from locsnn_compile.passes.cuba.quantize import quantize_soft
from locsnn_compile.passes.rounding.task import NEAREST, Task
from locsnn_compile.passes.srm.quantize import STRATEGIES
from locsnn_compile.settings import Setting

EXAMPLES = Path(__file__).parents[2] / "examples"
# Narrower registers, and fewer steps and bits, than loihi-sim has.
OTHER = {
    "charge_bits": 19,
    "current_bits": 20,
    "voltage_bits": 16,
    "refractory_max": 7,
    "delay_max": 10,
    "weight_bits_max": 4,
}


def chip_text(compartments=64, formats=16, **registers):
    """Return the chip file of ``loihi-sim`` with some registers and limits changed."""
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
    """Return a network that ships with the project."""
    return lc.load(EXAMPLES / "models" / f"{name}.pt")


@pytest.fixture
def other(tmp_path):
    """Path of a chip file with the registers :data:`OTHER`."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(**OTHER))
    return path


@cache
def recordings(name):
    """Return the first shipped recording (1, steps, channels), padded to the steps of a network."""
    spikes = read_recordings(EXAMPLES / "recordings" / "touches.npz").spikes[:1]
    return network(name).fit(spikes, "touches")


def check_engines(program, spikes):
    """Check that both engines give the same integers; return the result of the fast one."""
    probe = ("spikes", "u", "v")
    fast = hw.simulate(program, spikes, engine="fast", probe=probe, skip=False)
    reference = hw.simulate(program, spikes, engine="reference", probe=probe, skip=False)
    assert fast.counts == reference.counts
    for kind in probe:
        for group, expected in getattr(reference, kind).items():
            assert np.array_equal(getattr(fast, kind)[group], expected), (kind, group)
    return fast


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["auto", *STRATEGIES])
@pytest.mark.parametrize("name", ["objects-hybrid", "containers-hybrid"])
def test_examples_compile_for_another_chip(other, name, strategy):
    """A network of spike response neurons is rounded for the chip, so that the chip holds every number."""
    compiled = lc.compile(
        network(name), target=other, strategy=strategy, events=recordings(name), diagnosis=False
    )
    assert compiled.report["weight_bits"] == OTHER["weight_bits_max"]
    assert compiled.program.chip.registers.voltage_max == 2**16 - 1
    weight_bits = set()
    for core in compiled.program.cores:
        weight_bits |= {synapse_format.weight_bits for synapse_format in core.axons.formats}
        assert core.axons.delay.max(initial=0) <= OTHER["delay_max"]
        for profile in core.profiles:
            assert profile.refractory <= OTHER["refractory_max"]
        assert core.compartments <= 64
        assert 64 * max(core.thresholds) < 2**16 - 1
    assert max(weight_bits) == OTHER["weight_bits_max"]
    match = compiled.report["match"]
    assert match["reference_spikes"] > 0
    assert match["spike_agreement"] > 0.3
    result = check_engines(compiled.program, recordings(name))
    assert result.counts.spikes > 0


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
    """Each sign and own spikes need a format, so that three formats leave one grade of weights."""
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
def test_integer_examples_run_on_another_chip_or_its_limit_is_named(
    tmp_path, name, registers, message
):
    """Integers are kept as they are, so a chip that does not hold one of them is refused."""
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
    """Their potentials are read and never reach the threshold, so the threshold may exceed the voltage register.

    The chip has half the voltage of ``loihi-sim``. Inputs spike in every fourth step, which keeps potentials below its
    end, so both chips give the same scores.
    """
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(voltage_bits=22))
    read = lc.Population("read", "time", 2, lc.Cuba.of(2, decay_u=0.5, decay_v=0.25, threshold=8.8))
    onto = lc.Projection("touch", "read", np.array([[1.0, 0.0], [-0.5, 0.25]]))
    network = lc.Network(
        name="reads",
        channels=2,
        steps=40,
        views=(lc.InputView("touch", "time", 2),),
        populations=(read,),
        projections=(onto,),
        readout=lc.Readout(("read",), (1.0,), potentials_from=1),
    )
    played = np.zeros((1, 40, 2), dtype=np.uint8)
    played[:, ::4] = 1
    integers = lc.compile(network, events=played, diagnosis=False).levels.quantized.on_grid()
    on_other = lc.compile(integers, target=path, events=played, diagnosis=False)
    on_loihi = lc.compile(integers, target="loihi-sim", events=played, diagnosis=False)
    threshold = 64 * int(integers.populations[0].neuron.threshold[0])
    assert threshold > on_other.program.chip.registers.voltage_max
    assert on_other.report["match"]["clips"] == 0
    scores = hw.simulate(on_other.program, played).scores
    assert np.array_equal(scores, hw.simulate(on_loihi.program, played).scores)


def test_a_program_by_hand_runs_on_another_chip():
    chip = parse_chip(chip_text(**OTHER), "other.yaml")
    r = np.random.default_rng(0)
    b = hw.ProgramBuilder(chip)
    x = b.add_input("x", 20)
    h = b.add_compartments(
        "h",
        200,
        decay_u=r.integers(1, 4097, 200),
        decay_v=r.integers(0, 4097, 200),
        threshold=r.integers(1, 900, 200),
        bias=64,
        refractory=r.integers(1, 8, 200),
    )
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
    # All that depends on the width of a register happens.
    assert min(counts.spikes, counts.charge_wraps, counts.current_wraps, counts.voltage_clips) > 0
    # 200 compartments of h and 9 of o, 64 per core.
    assert len(program.cores) >= 4
    assert {name for name in COUNT_NAMES if not hasattr(counts, name)} == set()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(
            {"weight_bits": 5},
            "synapses 'x' -> 'h': weights of 5 bits are too wide (other has weight_bits_max 4). "
            "Use narrower weights.",
            id="weights",
        ),
        pytest.param(
            {"delay": 11},
            "synapses 'x' -> 'h': a delay is out of range (11 against 0..10 steps; "
            "1 of 1 delay outside). Relay the spike through 1 compartment, or shorten the delay.",
            id="delays",
        ),
    ],
)
def test_synapses_beyond_the_limits_of_another_chip_are_refused(change, message):
    b = hw.ProgramBuilder(parse_chip(chip_text(**OTHER), "other.yaml"))
    x = b.add_input("x", 1)
    h = b.add_compartments("h", 1, threshold=1)
    b.connect(x, h, [[32]], **change)
    with pytest.raises(TargetError) as caught:
        b.build()
    assert str(caught.value) == message


@pytest.mark.parametrize("bits", [5, 8])
def test_more_weight_bits_than_the_chip_has_are_refused(other, bits):
    with pytest.raises(TargetError) as caught:
        lc.compile(network("objects-hybrid"), target=other, weight_bits=bits)
    assert str(caught.value) == (
        f"--weight-bits: weights of {bits} bits are too wide (other has weight_bits_max 4). "
        "Ask for 4, or leave it out."
    )


@pytest.mark.slow
@pytest.mark.parametrize("delay_max", [0, 3])
def test_a_strategy_that_needs_longer_delays_is_refused(tmp_path, delay_max):
    """The error names the limit if the strategy was given; ``auto`` takes another strategy."""
    path = tmp_path / "other.yaml"
    path.write_text(chip_text(delay_max=delay_max))
    with pytest.raises(TargetError) as caught:
        lc.compile(network("objects-hybrid"), target=path, strategy="delay-line", diagnosis=False)
    tau_ref = network("objects-hybrid").populations[0].neuron.tau_ref
    synapses = "1 delayed synapse" if delay_max == 0 else f"{delay_max + 1} delayed synapses"
    message = re.sub(r"an error of \S+ ", "an error of ... ", str(caught.value))
    assert message == (
        f"population 'time_hidden': {synapses} cannot hold a kernel of tau_ref {tau_ref:g} "
        f"(an error of ... against 0.1; other has delay_max {delay_max}). Use strategy dendrite."
    )
    compiled = lc.compile(
        network("objects-hybrid"), target=path, events=recordings("objects-hybrid"), diagnosis=False
    )
    tried = [row["strategy"] for row in compiled.report["strategy_choice"]["candidates"]]
    assert tried == ["dendrite", "reset"]


@pytest.mark.parametrize("bits", [1, 2, 3, 4, 5, 6, 8])
def test_self_synapses_hold_the_drop_of_a_spike_with_any_weight_bits(bits):
    """Two self-synapses (taps) hold exactly what a spike subtracts, whatever the chip's widest weights."""
    chip = parse_chip(chip_text(weight_bits_max=bits), "other.yaml")
    drop = np.linspace(0.2, 1.0, 5)
    neuron = SoftCuba.of(5, decay_u=0.5, decay_v=0.1, threshold=1.0, drop=drop)
    grid = weight_grid(bits, "excitatory")
    task = Task(
        population=lc.Population("n", "time", 5, neuron),
        incoming=(lc.Projection("touch", "n", np.full((5, 1), 0.5)),),
        chip=chip,
        grid=grid,
        setting=Setting("dendrite", weight_bits=8),
        rounding=NEAREST,
        calibration=None,
    )
    quantized = quantize_soft(neuron, task).neuron
    taps = quantized.refractory
    assert not grid.off_grid(np.abs(taps.mantissa)).any()
    charges = taps.mantissa * 2.0 ** taps.exponent[:, None]
    of_the_next_step = charges[taps.delay == 0].sum(axis=0)
    assert np.array_equal(-of_the_next_step, np.rint(quantized.threshold * drop))
