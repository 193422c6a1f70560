"""Shipped networks compiled for SpiNNaker: their spikes, scales and reports.

The numbers of spikes are those of an independent model of the chip. The shifts of sPyNNaker's own choice are those that
sPyNNaker chose when it mapped the emitted network.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.errors import TargetError
from hw_model.spinnaker.chips import spinnaker_chip
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.spinnaker.compiled import CompiledSpinnaker

CHIP = spinnaker_chip("spinnaker1")
TOUCHES = "examples/recordings/touches.npz"
TIME_STEPS = 250
"""The steps of the time phase of objects-hybrid."""
TAXELS = 78
"""The channels of its sensor, which are the steps of its location phase."""
NEURONS_PER_BRANCH = 68
"""32 hidden neurons and 36 classes in each branch."""
NS_PER_STEP = 1e6
"""A board takes 1 ms for a step."""


def compiled(model: str, events: str | None = None) -> CompiledSpinnaker:
    """Compile a shipped model; without recordings, it is checked on made-up ones."""
    network = lc.load(f"examples/models/{model}.pt")
    return lc.compile(network, CHIP, events=events)


@pytest.fixture(scope="module")
def hybrid() -> CompiledSpinnaker:
    """The shipped hybrid, checked on eight recordings."""
    return compiled("objects-hybrid", TOUCHES)


def test_the_hybrid_has_15_558_of_the_15_559_spikes_of_its_integers(hybrid):
    rows = {
        name: (match.reference_spikes, match.chip_spikes, match.common_spikes)
        for name, match in hybrid.match.integers.items()
    }
    assert rows == {
        "time_hidden": (6910, 6910, 6909),
        "time_output": (212, 212, 212),
        "location_hidden": (7500, 7500, 7500),
        "location_output": (937, 937, 937),
    }
    counts = hybrid.match.total_counts
    assert (counts.wraps, counts.saturated_weights, counts.late_synapses) == (0, 0, 0)


def test_the_shifts_that_spynnaker_chooses_would_cost_the_location_branch_its_spikes(hybrid):
    rows = {
        name: (own_scale.ring_shifts, own_scale.program_spikes, own_scale.equal_spikes)
        for name, own_scale in hybrid.figures.own_scale.items()
    }
    # The shifts are those that sPyNNaker 7.4.1 chose when it mapped the emitted network.
    assert rows == {
        "time_hidden": ((15, 15), 6910, 6910),
        "time_output": ((13, 14), 212, 212),
        "location_hidden": ((15, 14), 7500, 6880),
        "location_output": ((14, 14), 937, 643),
    }


def test_the_report_says_scales_time_and_what_is_not_known(hybrid):
    report = hybrid.report
    assert report["energy"]["per_sample_pj"] is None
    steps = TIME_STEPS + TAXELS
    assert report["latency"]["per_sample_ns"] == steps * NS_PER_STEP
    assert report["operations"]["per_sample"]["neuron_updates"] == steps * NEURONS_PER_BRANCH
    hidden = report["quantization"]["location_hidden"]
    assert (hidden["weight_unit_na"], hidden["potential_unit_mv"]) == (0.25, 1 / 64)
    assert hidden["ring_shifts"] == [13, 11]
    assert report["resources"]["limits"]["cores"] == {"used": 2, "limit": 856}
    proven = report["range_proof"]["location_hidden"]
    assert (proven["safe_period"], proven["events_per_second"]) == (1, 1000.0)
    # Weights of the heaviest neuron, in units of 2^-2 nA, of which 65,535 fit.
    assert proven["ring_share"] == hidden["largest_sums_na"][0] * 4 / 65535
    page = hybrid.files()["report.md"].decode()
    assert "| location_hidden | 1,000 | 38.0 % | 97.7 % | 70.7 % |" in page
    assert "| location_output | 11, 12 | 14, 14 | 937 | 643 | 31.4 % |" in page
    assert "| time_hidden | 99.986 % | 6,910 | 6,910 | 2 |" in page
    assert "Energy is not known, because no table of the energies of this chip was checked." in page
    assert "objects-hybrid on spinnaker1" in hybrid.to_html()


@pytest.mark.slow
def test_no_report_says_that_resets_were_calibrated(hybrid):
    """Their weights are rounded one by one: other recordings give the same program."""
    sparse = (np.random.default_rng(0).random((2, TIME_STEPS, TAXELS)) < 0.02).astype(np.uint8)
    network = hybrid.network
    for target in ("spinnaker1", "loihi-sim"):
        usual = lc.compile(network, target, "reset", events=TOUCHES)
        on_sparse = lc.compile(network, target, "reset", events=TOUCHES, calibration=sparse)
        assert usual.report["assumptions"] == on_sparse.report["assumptions"] == []
        assert usual.files()["program.npz"] == on_sparse.files()["program.npz"]


def test_a_network_of_windows_keeps_every_spike_and_class():
    windows = compiled("containers-window-16")
    assert windows.match.prediction_agreement == 1
    assert windows.match.spikes.mismatches == 0
    assert all(match.mismatches == 0 for match in windows.match.integers.values())
    assert windows.match.scores.relative_error < 0.01


def test_delays_arrive_as_in_the_network():
    fingertips = compiled("two-fingertips")
    assert fingertips.match.prediction_agreement == 1
    # The power of two that holds the longest delay of the network.
    assert fingertips.program.network.population("location_hidden").slots == 8
    agreed = [match.agreement for match in fingertips.match.integers.values()]
    assert min(agreed) > 0.999


@pytest.mark.parametrize("steps", [20, 160], ids=["shorter", "longer"])
def test_a_network_of_any_length_takes_the_steps_of_recordings(steps):
    """Made-up recordings to calibrate on are as long as those of the check, as for ``loihi-sim``."""
    description = NetworkDescription(
        "tactile-snn", InputLayout(neutouch(1), steps=40, step_seconds=0.02), 3, hidden=6
    )
    random = np.random.default_rng(0)
    weights = {
        name: random.normal(0.5, 2.0, shape).astype(np.float32)
        for name, shape in description.weight_shapes.items()
    }
    network = replace(lc.load(Checkpoint(description, weights)), any_length=True)
    events = (random.random((3, steps, TAXELS)) < 0.2).astype(np.uint8)
    spinnaker = lc.compile(network, "spinnaker1", events=events)
    loihi = lc.compile(network, "loihi-sim", "reset", events=events, diagnosis=False)
    for name, numbers in loihi.report["quantization"].items():
        assert spinnaker.report["quantization"][name]["scale"] == numbers["scale"]
    projections = zip(
        spinnaker.quantized.projections, loihi.levels.quantized.projections, strict=True
    )
    for on_spinnaker, on_loihi in projections:
        assert np.array_equal(on_spinnaker.mantissa, on_loihi.mantissa)


def test_integers_of_joined_compartments_are_refused():
    with pytest.raises(TargetError) as caught:
        compiled("objects-hybrid-loihi")
    assert str(caught.value) == (
        "population 'time_hidden': its integers join compartments, and a neuron of SpiNNaker is a "
        "single one. Give the network in float, as it was before it was trained in integers."
    )
