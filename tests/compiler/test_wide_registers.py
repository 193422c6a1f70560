"""Wraps and clips: what wide registers would do, by hand, and what the report of a build says of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.program import widened
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.report.sections.registers import registers
from locsnn_compile.request.without_overflows import try_widths
from locsnn_compile.settings import Setting
from locsnn_compile.verification import wide_registers
from locsnn_compile.verification.wide_registers import play_wide
from tests.support.networks import hybrid, recordings, single

DOWN = 256 << 13
"""Charge of the heaviest negative weight: -256, exponent 7, in registers."""
UP = 254 << 13
END = (1 << 23) - 1


def integrator(bits=23, **settings):
    """A compartment that keeps all of v: channel 0 pulls it down, channel 1 up."""
    chip = hw.chip("loihi-sim")
    chip = replace(chip, registers=replace(chip.registers, voltage_bits=bits))
    builder = hw.ProgramBuilder(chip)
    touch = builder.add_input("touch", 2)
    parameters = {"decay_u": 4096, "decay_v": 0, "threshold": 1000, **settings}
    neuron = builder.add_compartments("neuron", 1, **parameters)
    builder.connect(touch, neuron, np.array([[-256, 254]]), exponent=7)
    return builder.build()


def pulled(down, up):
    """A recording that pulls down so often, then up, and ends a step later."""
    steps = np.zeros((down + up + 1, 2), dtype=np.uint8)
    steps[:down, 0] = 1
    steps[down:-1, 1] = 1
    return steps[None]


def test_a_potential_that_was_clipped_stays_low_in_wide_registers():
    program = integrator()
    recording = pulled(6, 5)
    # -6 DOWN is below the register: it is clipped, and 5 UP lift it above the threshold.
    assert -END + 5 * UP > 64_000 > -6 * DOWN + 5 * UP
    clipped = hw.simulate(program, recording, probe=("spikes", "v"))
    assert clipped.spikes["neuron"][0, :, 0].tolist() == [0] * 11 + [1]
    wide = play_wide(program, recording)
    assert wide is not None
    assert not wide.spikes["neuron"].any()
    assert sum(counts.clips for counts in wide.per_recording) == 0


def test_a_potential_beyond_32_bits_needs_the_widest_registers():
    program = integrator()
    steps = 100
    recording = pulled(steps, 0)
    assert steps * DOWN > 1 << widened.HANDY_VOLTAGE_BITS
    wide = play_wide(program, recording)
    assert wide is not None
    assert wide.potential["neuron"][0, :, 0].tolist() == [-k * DOWN for k in range(steps + 1)]


def test_a_floor_of_the_program_stays_in_wide_registers():
    program = integrator(vmin=1 - (1 << 20))
    wide = play_wide(program, pulled(6, 1))
    assert wide is not None
    potential = wide.potential["neuron"][0, :, 0].tolist()
    floor = 1 - (1 << 20)
    assert potential == [0, *[floor] * 6, floor + UP][:8]


def test_charge_that_wraps_is_whole_in_wide_registers():
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    touch = builder.add_input("touch", 2)
    neuron = builder.add_compartments("neuron", 1, decay_u=4096, decay_v=4096, threshold=100_000)
    builder.connect(touch, neuron, np.array([[254, 254]]), exponent=7)
    program = builder.build()
    recording = np.array([[[1, 1], [0, 0]]], dtype=np.uint8)
    wrapped = hw.simulate(program, recording, probe=("u",))
    assert wrapped.u["neuron"][0, 1, 0] == 2 * UP - (1 << 22)
    wide = play_wide(program, recording)
    assert wide is not None
    assert wide.potential["neuron"][0, 1, 0] == 2 * UP


def test_what_no_register_holds_is_not_played(monkeypatch):
    monkeypatch.setattr(wide_registers, "with_wide_registers", lambda program: program)
    monkeypatch.setattr(wide_registers, "with_wide_voltages", lambda program: program)
    assert play_wide(integrator(), pulled(6, 5)) is None


def inhibited():
    """Two classes; the first is pulled far down before it is pulled up, the second spikes once."""
    size = 2
    neuron = Cuba(
        decay_u=np.ones(size),
        decay_v=np.zeros(size),
        threshold=np.ones(size),
        bias=np.zeros(size),
        refractory=np.ones(size, dtype=np.int64),
    )
    network = single(neuron, [[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]], steps=80)
    spikes = np.zeros((3, 80, 3), dtype=np.uint8)
    spikes[0, :30, 0] = 1
    spikes[0, 30:55, 1] = 1
    spikes[:, 70:72, 2] = 1
    return network, spikes


def verdict_of(compiled):
    """The answer of the report to whether registers are wide enough."""
    figures = compiled.figures
    return registers(figures, figures.overflows, figures.range)


def facts_of(verdict):
    return {fact.label: fact.value for fact in verdict.facts}


def test_clips_that_change_a_class_get_a_no():
    network, spikes = inhibited()
    compiled = lc.compile(network, "loihi-sim", events=spikes)
    overflows = compiled.report["overflows"]
    # The register ends at -16 thresholds. The float network goes down by 30 of them, and 25 up are
    # not enough for a spike of the first class.
    (threshold,) = set(compiled.program.cores[0].threshold_voltage.tolist())
    assert END // threshold == 16
    assert compiled.report["match"]["prediction_agreement"] == pytest.approx(2 / 3)
    assert overflows["matters"] == "predictions"
    assert overflows["recordings"] == 1
    assert overflows["wide_registers"]["predictions_changed"] == 1
    assert overflows["wide_registers"]["prediction_agreement"] == 1.0
    assert overflows["wide_registers"]["spike_agreement"] == 1.0
    verdict = verdict_of(compiled)
    assert (verdict.status, verdict.answer) == ("no", "No")
    chip_spikes = compiled.report["match"]["spike_mismatches"]
    clips = compiled.report["match"]["clips"]
    assert verdict.sentence == (
        f"{clips} clips in 1 of 3 recordings change {chip_spikes} spikes and 1 prediction."
    )
    assert facts_of(verdict)["without them"].startswith(
        "100 % of the predictions equal instead of 66.7 %, 100 % of the spikes equal instead of "
    )


def test_clips_are_not_known_to_matter_where_no_register_is_wide_enough(monkeypatch):
    network, spikes = inhibited()
    monkeypatch.setattr(wide_registers, "play_wide", lambda program, recordings: None)
    compiled = lc.compile(network, "loihi-sim", events=spikes)
    assert compiled.report["overflows"] == {
        "matters": "not known",
        "recordings": 1,
        "not_known": "even registers of 40 bits are too narrow",
        "wide_registers": None,
        "settings": None,
    }
    verdict = verdict_of(compiled)
    clips = compiled.report["match"]["clips"]
    assert (verdict.status, verdict.answer) == ("unknown", "Not known")
    assert verdict.sentence == (
        f"Whether {clips} clips change anything is not known: even registers of 40 bits are too narrow."
    )


def test_a_network_without_overflows_has_wide_enough_registers():
    network, spikes = inhibited()
    compiled = lc.compile(network, "loihi-sim", events=spikes[1:])
    verdict = verdict_of(compiled)
    assert (verdict.status, verdict.sentence) == ("yes", "No register wrapped or was clipped.")
    assert compiled.report["overflows"]["matters"] == "nothing overflows"


def narrow_chip(bits):
    chip = hw.chip("loihi-sim")
    return replace(chip, registers=replace(chip.registers, voltage_bits=bits))


def test_settings_without_clips_are_named_with_their_price():
    network = hybrid(6)
    played = recordings(network, samples=6, rate=0.5)
    compiled = lc.compile(network, narrow_chip(14), events=played, strategy="dendrite")
    overflows = compiled.report["overflows"]
    assert overflows["matters"] == "spikes or scores"
    settings = overflows["settings"]
    for found in settings["without"]:
        again = lc.compile(
            network,
            narrow_chip(14),
            events=played,
            calibration=played,
            strategy=found["strategy"],
            weight_bits=found["weight_bits"],
        ).report
        assert again["match"]["clips"] == again["match"]["wraps"] == 0
        assert again["match"]["spike_agreement"] == pytest.approx(found["spike_agreement"])
        ratio = again["energy"]["per_sample_pj"] / compiled.report["energy"]["per_sample_pj"]
        assert found["energy_ratio"] == pytest.approx(ratio)
    assert [(found["strategy"], found["weight_bits"]) for found in settings["without"]] == [
        ("dendrite", 2),
        ("reset", 8),
    ]
    verdict = verdict_of(compiled)
    assert (verdict.status, verdict.answer) == ("nearly", "Nearly, no prediction changes")
    assert facts_of(verdict)["removed by"] == (
        "--weight-bits 2 (on 6 recordings that have some: 100 % of the predictions equal instead of "
        "100 %, 90.0 % of the spikes equal instead of 98.2 %, 0.987 times the energy, 0.991 times "
        "the time)"
    )


WIDTHS = (6, 5, 4, 3, 2, 1)


class WidthTrial:
    """Stands for trials of narrower weights: the chip holds some widths, and some of these are clean."""

    def __init__(self, clean, held):
        self.clean = clean
        self.held = held
        self.measured = []

    def measure(self, setting):
        bits = setting.weight_bits
        self.measured.append(bits)
        return SimpleNamespace(overflows=int(bits not in self.clean)) if bits in self.held else None


@pytest.mark.parametrize(
    ("clean", "held", "measured"),
    [
        pytest.param((), WIDTHS, [1], id="not even the narrowest"),
        pytest.param(WIDTHS, WIDTHS, [1, 4, 5, 6], id="all of them"),
        pytest.param((3, 2, 1), WIDTHS, [1, 4, 2, 3], id="from 3 bits down"),
        pytest.param((4, 3, 2, 1), WIDTHS, [1, 4, 5], id="from 4 bits down"),
        pytest.param((3, 2), (6, 5, 4, 3, 2), [1, 2, 4, 3], id="1 bit cannot be held"),
        pytest.param((), (), [1, 2, 3, 4, 5, 6], id="none can be held"),
    ],
)
def test_the_widest_weights_without_overflows_are_bisected(clean, held, measured):
    trial = WidthTrial(clean, held)
    try_widths(trial, [Setting("dendrite", bits) for bits in WIDTHS])
    asked = list(dict.fromkeys(trial.measured))
    assert asked == measured
    if clean:
        assert max(clean) in asked
        assert max(clean) == 6 or max(clean) + 1 in asked


def test_registers_that_a_network_was_trained_with_are_its_own():
    compiled = lc.compile(
        lc.load("examples/models/containers-hybrid-loihi.pt"), "loihi-sim", diagnosis=False
    )
    assert compiled.report["overflows"]["matters"] == "as in the network"
    verdict = verdict_of(compiled)
    assert (verdict.status, verdict.answer) == ("yes", "Yes, as in the network")
    assert verdict.sentence == (
        "831 clips in 14 of 16 recordings are those of the network's own integers, which have the "
        "same registers; wide ones would change 84 spikes and no prediction."
    )


@pytest.mark.slow
def test_for_a_few_spikes_no_other_setting_is_looked_for():
    compiled = lc.compile(
        lc.load("examples/models/objects-hybrid.pt"),
        "loihi-sim",
        strategy="dendrite",
        events="examples/recordings/touches.npz",
    )
    overflows = compiled.report["overflows"]
    assert overflows["matters"] == "spikes or scores"
    assert overflows["wide_registers"]["spikes_changed"] == 1
    assert overflows["settings"] is None
