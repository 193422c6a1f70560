"""Wraps and clips: what a program would do in registers so wide that nothing overflows, and what the report says about it.

Results are worked out by hand for one compartment that input pulls down and up. Its registers: charges of 21 bits wrap,
voltages of 23 bits are clipped; the sign comes on top.
"""

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
from tests.support.register_units import CHARGE_RANGE

DOWN = 256 << 13
"""Magnitude of the charge of the largest negative weight, in register units: mantissa 256, times 2^7, times 64."""
UP = 254 << 13
"""Charge of the largest positive weight."""
END = (1 << 23) - 1
"""The largest voltage. The lowest is its negative."""


def chip_with_voltages_of(bits):
    """Return the chip with voltages of ``bits`` bits instead of 23."""
    chip = hw.chip("loihi-sim")
    return replace(chip, registers=replace(chip.registers, voltage_bits=bits))


def integrator(bits=23, **settings):
    """Return a program of one compartment that keeps all of its voltage: channel 0 pulls it down, channel 1 up.

    An event acts one step later: it changes the voltage by ``-DOWN`` or ``UP``.
    """
    builder = hw.ProgramBuilder(chip_with_voltages_of(bits))
    touch = builder.add_input("touch", 2)
    parameters = {"decay_u": 4096, "decay_v": 0, "threshold": 1000, **settings}
    neuron = builder.add_compartments("neuron", 1, **parameters)
    builder.connect(touch, neuron, np.array([[-256, 254]]), exponent=7)
    return builder.build()


def pulled(down, up):
    """Return a recording with ``down`` steps of pulling down, then ``up`` of pulling up, and one more, in which the last acts."""
    steps = np.zeros((down + up + 1, 2), dtype=np.uint8)
    steps[:down, 0] = 1
    steps[down:-1, 1] = 1
    return steps[None]


def test_a_potential_that_was_clipped_stays_low_in_wide_registers():
    program = integrator()
    recording = pulled(down=6, up=5)
    # Six pulls down leave the register, so that the voltage is clipped, and five up lift it above the threshold, four do
    # not. Without the clip, five would not either.
    threshold = 64 * 1000
    assert -6 * DOWN < -END
    assert -END + 5 * UP > threshold > -END + 4 * UP
    assert threshold > -6 * DOWN + 5 * UP
    clipped = hw.simulate(program, recording, probe=("spikes", "v"))
    # The last of the eleven pulls acts in the twelfth step.
    assert clipped.spikes["neuron"][0, :, 0].tolist() == [0] * 11 + [1]
    wide = play_wide(program, recording)
    assert wide is not None
    assert not wide.spikes["neuron"].any()
    assert sum(counts.clips for counts in wide.per_recording) == 0


def test_a_potential_that_leaves_the_first_wide_voltages_needs_the_widest_registers():
    """Wide voltages of 27 bits, which play fastest, are tried first, and then registers of 40 bits."""
    program = integrator()
    steps = 100
    recording = pulled(steps, 0)
    assert steps * DOWN > 1 << widened.HANDY_VOLTAGE_BITS
    wide = play_wide(program, recording)
    assert wide is not None
    assert wide.potential["neuron"][0, :, 0].tolist() == [-k * DOWN for k in range(steps + 1)]


def test_a_lowest_voltage_of_the_program_stays_in_wide_registers():
    # The first pull down is larger, so the voltage is clipped from then on.
    floor = 1 - (1 << 20)
    wide = play_wide(integrator(vmin=floor), pulled(down=6, up=1))
    assert wide is not None
    potential = wide.potential["neuron"][0, :, 0].tolist()
    assert potential == [0, *[floor] * 6, floor + UP]


def test_a_charge_that_wraps_does_not_wrap_in_wide_registers():
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    touch = builder.add_input("touch", 2)
    neuron = builder.add_compartments("neuron", 1, decay_u=4096, decay_v=4096, threshold=100_000)
    builder.connect(touch, neuron, np.array([[254, 254]]), exponent=7)
    program = builder.build()
    recording = np.array([[[1, 1], [0, 0]]], dtype=np.uint8)
    wrapped = hw.simulate(program, recording, probe=("u",))
    # In two's complement, a charge just beyond its range comes back at the other end.
    assert wrapped.u["neuron"][0, 1, 0] == 2 * UP - CHARGE_RANGE
    wide = play_wide(program, recording)
    assert wide is not None
    assert wide.potential["neuron"][0, 1, 0] == 2 * UP


def test_a_program_that_overflows_even_in_wide_registers_is_not_played(monkeypatch):
    """Registers are left as they are here, in place of wide ones that are not wide enough: the clips remain."""
    monkeypatch.setattr(wide_registers, "with_wide_registers", lambda program: program)
    monkeypatch.setattr(wide_registers, "with_wide_voltages", lambda program: program)
    assert play_wide(integrator(), pulled(down=6, up=5)) is None


def inhibited():
    """Return a network of two classes and three recordings, of which the first clips.

    In the first recording, class 0 is pulled down for 30 steps and up for 25, each time by its threshold. In all of them,
    class 1 gets two inputs at the end, and spikes at the second: so without clips, class 1 is always predicted.
    """
    neuron = Cuba.of(2, decay_u=1.0, decay_v=0.0, threshold=1.0)
    network = single(neuron, [[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]], steps=80)
    spikes = np.zeros((3, 80, 3), dtype=np.uint8)
    spikes[0, :30, 0] = 1
    spikes[0, 30:55, 1] = 1
    spikes[:, 70:72, 2] = 1
    return network, spikes


def verdict_of(compiled):
    """Return the report's answer to whether registers are wide enough."""
    figures = compiled.figures
    return registers(figures, figures.overflows, figures.range)


def facts_of(verdict):
    """Return the facts of a verdict by their labels."""
    return {fact.label: fact.value for fact in verdict.facts}


def test_clips_that_change_a_prediction_make_the_answer_no():
    network, spikes = inhibited()
    compiled = lc.compile(network, "loihi-sim", events=spikes)
    overflows = compiled.report["overflows"]
    # The register ends at -16 thresholds. The float network goes down by 30 of them, from which 25 up are not enough for
    # a spike of class 0; the chip is clipped at -16, and spikes.
    (threshold,) = set(compiled.program.cores[0].threshold_voltage.tolist())
    assert END // threshold == 16
    assert compiled.report["match"]["prediction_agreement"] == pytest.approx(2 / 3)
    assert overflows["matters"] == "predictions"
    assert overflows["recordings"] == 1
    assert overflows["wide_registers"]["predictions_changed"] == 1
    assert overflows["wide_registers"]["prediction_agreement"] == 1.0
    assert overflows["wide_registers"]["spike_agreement"] == 1.0
    verdict = verdict_of(compiled)
    assert verdict.status == "no"
    assert verdict.answer == "No"
    # Without clips, the chip equals the network, so every mismatch with the network is the clips' doing.
    changed_spikes = compiled.report["match"]["spike_mismatches"]
    clips = compiled.report["match"]["clips"]
    assert verdict.sentence == (
        f"{clips} clips in 1 of 3 recordings change {changed_spikes} spikes and 1 prediction."
    )
    assert facts_of(verdict)["without them"].startswith(
        "100 % of the predictions equal instead of 66.7 %, 100 % of the spikes equal instead of "
    )


def test_whether_clips_matter_is_unknown_if_no_register_is_wide_enough(monkeypatch):
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
    assert verdict.status == "unknown"
    assert verdict.answer == "Not known"
    assert verdict.sentence == (
        f"Whether {clips} clips change anything is not known: even registers of 40 bits are too narrow."
    )


def test_a_network_without_overflows_has_wide_enough_registers():
    network, spikes = inhibited()
    # All but the first recording, which clips.
    compiled = lc.compile(network, "loihi-sim", events=spikes[1:])
    verdict = verdict_of(compiled)
    assert verdict.status == "yes"
    assert verdict.sentence == "No register wrapped or was clipped."
    assert compiled.report["overflows"]["matters"] == "nothing overflows"


def test_settings_without_clips_are_named_with_their_price():
    network = hybrid(seed=6)
    played = recordings(network, samples=6, rate=0.5)
    # So narrow that strategy "dendrite" clips with the widest weights, and not with the narrowest.
    chip = chip_with_voltages_of(14)
    compiled = lc.compile(network, chip, events=played, strategy="dendrite")
    overflows = compiled.report["overflows"]
    assert overflows["matters"] == "spikes or scores"
    settings_without_clips = overflows["settings"]["without"]
    for setting in settings_without_clips:
        # Weights are rounded for the same recordings as above: without others, those of the check.
        report = lc.compile(
            network,
            chip,
            events=played,
            calibration=played,
            strategy=setting["strategy"],
            weight_bits=setting["weight_bits"],
        ).report
        assert report["match"]["clips"] == report["match"]["wraps"] == 0
        assert report["match"]["spike_agreement"] == pytest.approx(setting["spike_agreement"])
        ratio = report["energy"]["per_sample_pj"] / compiled.report["energy"]["per_sample_pj"]
        assert setting["energy_ratio"] == pytest.approx(ratio)
    strategies_and_bits = [
        (setting["strategy"], setting["weight_bits"]) for setting in settings_without_clips
    ]
    assert strategies_and_bits == [("dendrite", 2), ("reset", 8)]
    verdict = verdict_of(compiled)
    assert verdict.status == "nearly"
    assert verdict.answer == "Nearly, no prediction changes"
    # The figures of the first setting, which the loop above has compared with a compile of its own; recorded from a run.
    assert facts_of(verdict)["removed by"] == (
        "--weight-bits 2 (on 6 recordings that have some: 100 % of the predictions equal instead of "
        "100 %, 90.0 % of the spikes equal instead of 98.2 %, 0.987 times the energy, 0.991 times "
        "the time)"
    )


WIDTHS = (6, 5, 4, 3, 2, 1)
"""Weight bits to try for a program that took 8: all narrower ones of the chip, the widest first."""


class WidthTrial:
    """Stands in for compiling with narrower weights.

    The chip can hold the widths ``possible``, and the widths ``clean`` have no overflows. ``measured`` lists the widths
    that were asked for, in this order.
    """

    def __init__(self, clean, possible):
        self.clean = clean
        self.possible = possible
        self.measured = []

    def measure(self, setting):
        """Return a candidate with its number of overflows, or None if the chip cannot hold the setting."""
        bits = setting.weight_bits
        self.measured.append(bits)
        if bits not in self.possible:
            return None
        return SimpleNamespace(overflows=int(bits not in self.clean))


@pytest.mark.parametrize(
    ("clean", "possible", "measured"),
    [
        pytest.param((), WIDTHS, [1], id="not even the narrowest"),
        pytest.param(WIDTHS, WIDTHS, [1, 4, 5, 6], id="all of them"),
        pytest.param((3, 2, 1), WIDTHS, [1, 4, 2, 3], id="from 3 bits down"),
        pytest.param((4, 3, 2, 1), WIDTHS, [1, 4, 5], id="from 4 bits down"),
        pytest.param((3, 2), (6, 5, 4, 3, 2), [1, 2, 4, 3], id="1 bit cannot be held"),
        pytest.param((), (), [1, 2, 3, 4, 5, 6], id="none can be held"),
    ],
)
def test_the_widest_weights_without_overflows_are_bisected(clean, possible, measured):
    trial = WidthTrial(clean, possible)
    try_widths(trial, [Setting("dendrite", bits) for bits in WIDTHS])
    # A real trial measures each setting once, and answers from memory if it is asked again.
    in_order = list(dict.fromkeys(trial.measured))
    assert in_order == measured
    if clean:
        # What was to be found, and that the next wider one has overflows.
        widest = max(clean)
        assert widest in in_order
        assert widest == max(WIDTHS) or widest + 1 in in_order


def test_clips_of_registers_that_a_network_was_trained_with_are_its_own():
    # The verdict needs no diagnosis, which would play the recordings many times more.
    compiled = lc.compile(
        lc.load("examples/models/containers-hybrid-loihi.pt"), "loihi-sim", diagnosis=False
    )
    assert compiled.report["overflows"]["matters"] == "as in the network"
    verdict = verdict_of(compiled)
    assert verdict.status == "yes"
    assert verdict.answer == "Yes, as in the network"
    # Counts recorded from a run, of the 16 recordings that the checkpoint carries.
    assert verdict.sentence == (
        "831 clips in 14 of 16 recordings are those of the network's own integers, which have the "
        "same registers; wide ones would change 84 spikes and no prediction."
    )


@pytest.mark.slow
def test_for_a_few_changed_spikes_no_other_setting_is_tried():
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
