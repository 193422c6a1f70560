"""A made-up family of chips, built only from what families share: the check, the report and refusals.

Its chip computes as the float network does, but loses every spike of hidden neuron 1 in step 3. Its counts are made up.
So every figure of the check and the report is known by hand.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.errors import InputError
from hw_model.values import Sums
from hw_model.xylo.chips import xylo_chip
from locsnn_compile.data.recordings import BATCH, Recordings
from locsnn_compile.emitters import ShownRecording
from locsnn_compile.own_arithmetic.comparison import (
    Batch,
    BatchMatch,
    ProgramMatch,
    ProgramRun,
    match_of_all,
    match_of_batch,
    sum_of_batches,
)
from locsnn_compile.own_arithmetic.document import (
    EnergyNotKnown,
    FirstEntries,
    LastEntries,
    TimeNotKnown,
    check_entries,
    recording_ns,
    skipped_entry,
)
from locsnn_compile.own_arithmetic.emitted import EmittedKinds, recording_to_show, text_file
from locsnn_compile.own_arithmetic.page import (
    FamilyPage,
    compose_page,
    costs_verdict,
    fits_verdict,
    limits_section,
    numbers_section,
    operations_section,
    provenance_section,
    worst_verdict,
)
from locsnn_compile.own_arithmetic.setting import OnlySetting
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.figures.entries import Entry, plain
from locsnn_compile.report.figures.match import Overflows
from locsnn_compile.report.figures.resources import LimitUse, ProgramUse
from locsnn_compile.report.format import any_value
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.settings import Setting

STEPS = 8
SAMPLES = BATCH + 2
"""Recordings of one full batch, and two of a second batch."""
LOST_STEP = 3
LOST_NEURON = 1
"""The step and the hidden neuron whose spike the chip loses."""
NO_TABLE = "no table of this chip is known"
"""The reason for unknown figures in the report."""


class Counts(Sums):
    """Counts of some recordings."""

    synaptic_ops: int = 0
    neuron_updates: int = 0
    spikes: int = 0
    input_events: int = 0
    transpose_events: int = 0


class Numbers(Entry):
    """A population of the made-up chip."""

    unit: float


class _Own(FirstEntries):
    latency: TimeNotKnown
    quantization: Mapping[str, Numbers]


class Figures(LastEntries, _Own):
    """report.json of the made-up chip."""


def relay(size: int) -> lc.Cuba:
    """Return neurons that spike one step after each event, and forget everything else."""
    return lc.Cuba.of(size, decay_u=1.0, decay_v=1.0, threshold=0.5)


@pytest.fixture(scope="module")
def network() -> lc.Network:
    """Two layers of neurons that repeat their input."""
    return lc.Network(
        name="relay",
        channels=2,
        steps=STEPS,
        views=(lc.InputView("touch", "time", 2),),
        populations=(
            lc.Population("hidden", "time", 2, relay(2)),
            lc.Population("classes", "time", 2, relay(2)),
        ),
        projections=(
            lc.Projection("touch", "hidden", np.eye(2)),
            lc.Projection("hidden", "classes", np.eye(2)),
        ),
        readout=lc.Readout(("classes",), (1.0,)),
        step_seconds=0.001,
    )


@pytest.fixture(scope="module")
def recordings() -> Recordings:
    """Silent recordings, except the last two, which have an event on channel 1 in steps 0 and 2."""
    spikes = np.zeros((SAMPLES, STEPS, 2), np.uint8)
    spikes[-2:, [0, 2], 1] = 1
    labels = np.ones(SAMPLES, dtype=np.int64)
    return Recordings(spikes, labels, step_seconds=0.001, source="by hand")


def compare_batch(network: lc.Network, batch: Batch) -> BatchMatch[Counts]:
    """Play a batch on the made-up chip, and compare it with the network."""
    reference = evaluate(network, batch.spikes, potentials=True)
    spikes = {name: array.copy() for name, array in reference.spikes.items()}
    spikes["hidden"][:, LOST_STEP, LOST_NEURON] = 0
    score_scale = 4.0
    scores = score_scale * network.readout.scores(spikes, {})
    counts = [
        Counts(
            synaptic_ops=10,
            neuron_updates=20,
            spikes=int(spikes_of_recording.sum()),
            input_events=1,
        )
        for spikes_of_recording in spikes["hidden"]
    ]
    run = ProgramRun(
        spikes=spikes,
        scores=scores,
        score_scale=score_scale,
        counts=tuple(counts),
        counts_by_phase={"time": sum(counts, start=Counts())},
        potential_at=lambda place: 0.25,
    )
    return match_of_batch(network, reference, run, batch.first_recording)


@pytest.fixture(scope="module")
def match(network, recordings) -> ProgramMatch[Counts]:
    """The comparison of all recordings. After each batch, progress is reported."""
    progress = []

    def report_progress(compared: int, samples: int) -> None:
        progress.append((compared, samples))

    sums = sum_of_batches(network, recordings, partial(compare_batch, network), report_progress)
    assert progress == [(BATCH, SAMPLES), (SAMPLES, SAMPLES)]
    return match_of_all(network, recordings, sums)


@pytest.fixture(scope="module")
def figures(network, match) -> Figures:
    """The content of the report."""
    grounds = Grounds(step_seconds=0.001, events_origin="given", assumptions=("It is made up.",))
    limits = {"neurons": LimitUse(used=4, limit=16), "inputs": LimitUse(used=2, limit=4)}
    return Figures(
        **check_entries(
            network, match, grounds, Overflows(wraps=0, clips=3, events={"all": {"full": 3}})
        ),
        target="made-up",
        strategy="native",
        weight_bits=8,
        energy=EnergyNotKnown(not_included=(NO_TABLE,)),
        latency=TimeNotKnown(basis=NO_TABLE, recording_ns=recording_ns(network, grounds)),
        resources=ProgramUse(
            cores=1,
            compartments=4,
            synapses=4,
            synapse_bits=32,
            axons_in=2,
            axons_out=2,
            limits=limits,
        ),
        skipped=skipped_entry(grounds, events_dropped=5),
        quantization={"hidden": Numbers(0.5)},
    )


def test_spikes_and_predictions_are_counted_over_all_batches(match):
    """Each of the last two recordings has 2 spikes of each layer; the chip lacks a hidden one.

    An event of step 0 spikes in step 1, and one of step 2 in step 3.
    """
    hidden = match.by_population["hidden"]
    assert (hidden.reference_spikes, hidden.chip_spikes, hidden.common_spikes) == (4, 2, 2)
    assert match.by_population["classes"].mismatches == 0
    assert match.chip_prediction.tolist() == [-1] * BATCH + [1, 1]
    assert match.scores.mean_error == 0
    assert match.total_counts == Counts(10 * SAMPLES, 20 * SAMPLES, 2, SAMPLES)
    assert match.accuracy == {"reference": 2 / SAMPLES, "chip": 2 / SAMPLES}


def test_the_first_spike_that_differs_is_of_the_second_batch(match):
    first = match.first_divergence
    assert first.recording == BATCH
    assert first.population == "hidden"
    assert (first.neuron, first.step) == (LOST_NEURON, LOST_STEP)
    assert first.reference_potential == 1.0
    assert first.chip_potential == 0.25
    assert first.threshold == 0.5


def test_the_report_has_the_entries_of_the_family_before_the_last_ones(figures):
    report = plain(figures)
    assert list(report) == [
        *("schema", "model", "target", "strategy", "weight_bits", "match", "accuracy"),
        *("operations", "energy", "latency", "resources", "ann_comparison", "skipped", "input"),
        *("assumptions", "gates", "quantization", "strategy_choice"),
    ]
    assert report["match"]["clips"] == 3
    assert report["operations"]["per_sample"]["synaptic_ops"] == 10
    # Four spikes of the hidden layer and four events, each along one synapse.
    assert report["operations"]["published_method"]["additions"] == 8 / SAMPLES
    assert report["energy"] == {
        "profile": None,
        "source": None,
        "per_sample_pj": None,
        "breakdown_pj": None,
        "not_included": [NO_TABLE],
    }
    assert report["latency"]["recording_ns"] == STEPS * 1e6
    assert report["skipped"]["events_dropped"] == 5
    json.dumps(report, allow_nan=False)


def test_the_page_says_what_the_family_has(figures):
    page = FamilyPage(
        lowering="as they are",
        costs=costs_verdict(
            figures, "Energy not known", f"Energy is not known, because {NO_TABLE}."
        ),
        fits=fits_verdict(figures, "4 of 16 neurons", taker="The program"),
        worst=worst_verdict("not known", "no times", f"It is not known, because {NO_TABLE}."),
        not_known={"energy": NO_TABLE},
        notices=(),
        sections=(
            operations_section(figures.operations, "What is counted."),
            limits_section(figures),
            numbers_section(
                figures.quantization, Numbers, "Units.", lambda _, value: any_value(value)
            ),
            provenance_section(figures, ("It is made up.",)),
        ),
    )
    report = compose_page(figures, page, host=None)
    assert [verdict.question for verdict in report.verdicts] == [
        "Does it match?",
        "Are registers wide enough?",
        "Does it fit?",
        "How fast at worst?",
        "What does it cost?",
        "What is not known?",
    ]
    text = render_markdown(report)
    assert f"**How fast at worst? Not known.** It is not known, because {NO_TABLE}." in text
    assert "Not known: other recordings and energy." in text
    assert "relay on made-up" in text
    assert f"8-bit weights, as they are, {SAMPLES} recordings of by hand" in text
    assert "The program takes 4 of 16 neurons of made-up." in text
    assert "| inputs | 2 | 4 | 50.0 % |" in text
    assert "| hidden | 0.5 |" in text


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"strategy": "reset"}, "strategy: chip-name joins them (got reset). Use strategy native."),
        ({"weight_bits": 4}, "weight_bits: all have 8 (got 4). Leave it out."),
        (
            {"split_weights": 0.5},
            "split_weights: chip-name has no such choice (got 0.5). Leave it out.",
        ),
    ],
    ids=["a reason and a fix", "a reason", "neither"],
)
def test_a_dial_with_another_value_is_refused(values, message):
    only = OnlySetting(
        Setting("native", weight_bits=8),
        reasons={"strategy": "{chip} joins them", "weight_bits": "all have 8"},
        fixes={"strategy": "Use strategy native."},
    )
    chip = xylo_chip("xylo-audio3")
    accepted = {"strategy": "auto", "weight_bits": 8, "split_weights": 0.0}
    assert only.for_dials(chip, accepted) == Setting("native", weight_bits=8)
    with pytest.raises(InputError) as caught:
        only.for_dials(chip, values)
    assert str(caught.value) == message.replace("chip-name", chip.name)


def test_kinds_of_emit_are_written_in_their_order_and_others_refused(network):
    kinds = EmittedKinds(
        writers={
            "first": lambda build, shown: text_file("first.txt", "\udc80"),
            "second": lambda build, shown: text_file(
                "second.txt", str(recording_to_show(build, shown).shape)
            ),
        },
        lacking="cores",
    )
    chip = xylo_chip("xylo-audio3")
    shown = ShownRecording(np.zeros((3, 2), np.uint8))
    files = kinds.files(network, chip, ("second", "first"), shown)
    assert list(files.items()) == [("first.txt", b"\\udc80"), ("second.txt", b"(8, 2)")]
    with pytest.raises(InputError) as caught:
        kinds.files(network, chip, ("second",), None)
    assert str(caught.value) == "emit: it shows a recording, and none is given. Give one."
    with pytest.raises(InputError) as caught:
        kinds.check(chip, ("dot",))
    assert str(caught.value) == (
        "--emit dot: it shows cores, and xylo-audio3 has none of them. "
        "Use --emit first or --emit second."
    )
