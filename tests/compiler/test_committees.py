"""Committees: several networks of one input in one program, whose class scores are weighted and added.

Tested are the scores against those of the networks alone, which inputs, phases and cores members share, what each member
costs, and which networks and weights are refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import Readout
from locsnn_compile.api import join
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import asked_layout, neutouch
from locsnn_compile.errors import InputError
from locsnn_compile.network.committee import committee
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.report.sections.verdict import member_words
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.first_touches import aligned, late, without_biases
from tests.support.networks import hybrid, on_grid, recordings

CHIP = hw.chip("loihi-sim")
EVENTS = st.sampled_from([None, None, 1, 2])
"""Events in a step at which a view starts; None: at the first step of the recording."""
POTENTIALS_FROM = st.sampled_from([None, 0, 3])
"""Step from which a member is read out by its largest potentials; None: by spikes."""
WEIGHTS = st.sampled_from([1.0, 2.0, 0.37, 5.3])


def members(seed, events, potentials_from):
    """Return two random integer networks of one input and equally many classes.

    ``events`` are those at which a member's time and location views start, ``potentials_from`` its first step of
    potentials, one item for each member.
    """
    networks = [without_biases(on_grid(seed + number, channels=5, steps=20)) for number in range(2)]
    sizes = [{population.size for population in network.populations} for network in networks]
    common_sizes = sizes[0] & sizes[1]
    assume(common_sizes)
    classes = max(common_sizes)
    finished = []
    for number, network in enumerate(networks):
        time_events, location_events = events[number]
        outputs = tuple(p.name for p in network.populations if p.size == classes)
        weights = (1.0,) * len(outputs)
        readout = Readout(outputs, weights, potentials_from=potentials_from[number])
        network = aligned(network, time_events, location_events)
        finished.append(replace(network, name=f"m{number}", readout=readout))
    return finished


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    events=st.tuples(st.tuples(EVENTS, EVENTS), st.tuples(EVENTS, EVENTS)),
    potentials_from=st.tuples(POTENTIALS_FROM, POTENTIALS_FROM),
    weights=st.tuples(WEIGHTS, WEIGHTS),
)
def test_scores_are_the_weighted_sum_on_every_side(seed, events, potentials_from, weights):
    networks = members(seed, events, potentials_from)
    joined = committee(networks, weights)
    played = late(recordings(joined, samples=4, seed=seed), seed)
    # The float reference of the committee against the members alone.
    alone = [evaluate(network, played) for network in networks]
    weighted_sum = weights[0] * alone[0].scores + weights[1] * alone[1].scores
    together = evaluate(joined, played)
    assert np.allclose(together.scores, weighted_sum, rtol=1e-12)
    for network, evaluated in zip(networks, alone, strict=True):
        for population in network.populations:
            spikes = together.spikes[f"{network.name}/{population.name}"]
            assert np.array_equal(spikes, evaluated.spikes[population.name])
    # The program against the reference, with both engines.
    levels = lower(joined, CHIP, weight_bits=8)
    match = compare(Observed(levels, played))
    assert match.spikes.mismatches == 0
    result = hw.simulate(levels.program, played, engine="reference")
    assert np.array_equal(result.scores, evaluate(levels.quantized.on_grid(), played).scores)
    assert np.array_equal(result.scores, hw.simulate(levels.program, played).scores)
    # The chip weighs by integers: its scores are the weighted sums times a factor, within a percent.
    assert all(weight.is_integer() for weight in levels.program.readout.weights)
    factors = result.scores / np.where(weighted_sum, weighted_sum, 1)
    factors = factors[factors != 0]
    assert len(factors) == 0 or factors.max() / factors.min() < 1.01
    # Sessions, which take a recording row by row, and early stops.
    for recording, scores in zip(played, result.scores, strict=True):
        assert np.array_equal(hw.Session(levels.program).push(recording).scores[-1], scores)
    stops = hw.stop_when_proven(levels.program, played)
    assert np.array_equal(stops.prediction, result.prediction)


def test_scores_that_do_not_vary_are_added_as_they_are():
    """Without calibration of their spreads, equal scores get equal weights, and the report says so."""
    networks = [hybrid(0), replace(hybrid(1), name="other")]
    silent = np.zeros((2, networks[0].steps, networks[0].channels), np.uint8)
    joined = join(networks, calibration=silent)
    assert [member.weight for member in joined.members] == [1.0, 1.0]
    assert joined.assumptions[-1] == (
        f"Class scores of {networks[0].name} and other are equal on array: "
        "scores are added as they are (--weights)."
    )


def named_hybrids(*names):
    """Return hybrids of one input with different weights."""
    return [replace(hybrid(seed, scale=20.0), name=name) for seed, name in enumerate(names)]


def three():
    """Return three hybrids of one input, of which the last starts at the first touch."""
    one, two, late = named_hybrids("one", "two", "late")
    return [one, two, aligned(late)]


def test_equal_inputs_and_phases_are_shared_but_no_cores():
    program = lower(committee(three(), (1, 1, 1)), CHIP, weight_bits=8).program
    assert [(phase.name, phase.align_events) for phase in program.phases] == [
        ("time", None),
        ("time_2", 1),
        ("location", None),
        ("location_2", 1),
    ]
    assert [(item.name, item.phase) for item in program.inputs] == [
        ("touch", "time"),
        ("touch_transposed", "location"),
        ("touch_2", "time_2"),
        ("touch_transposed_2", "location_2"),
    ]
    members_on_core = []
    for core in program.cores:
        members_on_core.append({piece.group.split("/")[0] for piece in core.slices})
    # Each member has a core for each of its two phases.
    assert sorted(members_on_core, key=min) == [{"late"}] * 2 + [{"one"}] * 2 + [{"two"}] * 2


def test_members_cost_what_they_cost_alone():
    """A member has the energy and time of its neurons and synapses; what brings events to members is shared.

    Members run side by side, so that together they take less than the sum of their times.
    """
    networks = named_hybrids("a", "b")
    played = recordings(networks[0], samples=5)
    both = lc.compile(networks, events=played, strategy="dendrite", weights=(1, 3), diagnosis=False)
    rows = both.report["model"]["members"]
    for network, row in zip(networks, rows, strict=True):
        alone = lc.compile(
            network,
            events=played,
            strategy="dendrite",
            calibration=both.network.recordings,
            diagnosis=False,
        )
        by_population = alone.report["energy"]["by_population_pj"]
        energy_pj = sum(population["pj"] for population in by_population.values())
        assert row["cores"] == alone.report["resources"]["cores"] == 2
        assert row["per_sample_pj"] == pytest.approx(energy_pj)
        assert row["per_sample_ns"] == pytest.approx(alone.report["latency"]["per_sample_ns"])
        assert row["name"] == network.name
        assert row["sha256"] == network.sha256
    assert [row["weight"] for row in rows] == [1.0, 3.0]
    times_ns = [row["per_sample_ns"] for row in rows]
    assert max(times_ns) <= both.report["latency"]["per_sample_ns"] < sum(times_ns)
    page = render_markdown(compose(both.figures))
    assert "a: " in page
    assert "2 cores, class scores times 3" in page
    assert both.report["resources"]["cores"] == 4


def test_on_an_open_core_no_member_has_a_time_of_its_own():
    """One core hosts all members, one after the other, so energy and time of a member are unknown."""
    networks = named_hybrids("a", "b")
    played = recordings(networks[0], samples=2)
    both = lc.compile(
        networks, "ecp5-25f", "dendrite", weights=(1, 3), events=played, diagnosis=False
    )
    rows = both.figures.model.members
    assert [(row.per_sample_pj, row.per_sample_ns) for row in rows] == [(None, None)] * 2
    assert both.report["latency"]["per_sample_ns"] > 0
    assert (
        member_words(rows[1]) == "energy not known, time not known, 2 cores, class scores times 3"
    )


def test_without_weights_scores_are_weighted_to_vary_alike():
    networks = [
        replace(hybrid(1, scale=30.0, steps=40), name="a"),
        replace(hybrid(2, scale=9.0, steps=40), name="b"),
    ]
    carried = Recordings(
        recordings(networks[0], samples=6),
        labels=None,
        step_seconds=0.02,
        source="few.pt",
        origin="carried",
    )
    # Without recordings there is nothing to measure how much scores vary.
    unmeasured = join(networks)
    assert [member.weight for member in unmeasured.members] == [1.0, 1.0]
    assert unmeasured.assumptions == (
        "Class scores of the networks are added as they are (--weights).",
    )
    measured = join([replace(networks[0], recordings=carried), networks[1]])
    spreads = [evaluate(network, carried.spikes).scores.std(axis=1).mean() for network in networks]
    assert measured.members[1].weight == pytest.approx(spreads[0] / spreads[1])
    assert measured.assumptions[0].startswith(
        "Class scores vary alike on 6 recordings of few.pt: weights a 1, b "
    )
    assert join(networks, calibration=carried).members == measured.members


def other(**changes):
    """Return two hybrids, of which the second has some fields changed."""
    return [hybrid(), replace(hybrid(1), name="other", **changes)]


def grid_and_fingertip():
    """Return two hybrids of different sensors with four channels."""
    grid = asked_layout("2x2", polarities=1, channels=None, layout=None)
    return [replace(hybrid(), sensor=grid), replace(hybrid(1), name="other", sensor=neutouch())]


@pytest.mark.parametrize(
    ("networks", "message"),
    [
        (other(channels=5), "it differs from 'small-hybrid' in channels (5 against 4)"),
        (other(steps=13), "it differs from 'small-hybrid' in steps (13 against 12)"),
        (
            other(step_seconds=0.1),
            "it differs from 'small-hybrid' in step seconds (0.1 against 0.02)",
        ),
        (
            [hybrid(), replace(hybrid(1, classes=3), name="other")],
            "it differs from 'small-hybrid' in classes (3 against 2)",
        ),
        (
            [
                replace(hybrid(), class_names=("a", "b")),
                replace(hybrid(1), name="other", class_names=("b", "a")),
            ],
            "it differs from 'small-hybrid' in class names (b, a against a, b)",
        ),
        (
            grid_and_fingertip(),
            "it differs from 'small-hybrid' in sensor (neutouch against grid 2x2)",
        ),
    ],
    ids=["channels", "steps", "seconds", "classes", "class names", "sensor"],
)
def test_members_that_disagree_are_refused(networks, message):
    with pytest.raises(InputError) as caught:
        lc.compile(networks, weights=(1, 2))
    assert str(caught.value) == f"model 'other': {message}. Join networks of one input."


@pytest.mark.parametrize(
    "weights",
    [
        (1,),
        (1, 0),
        (1, -2),
        (1, float("nan")),
        (1, float("inf")),
        (float("inf"), 1),
        (1e308, 1),
        (1, 1000001),
        (1, 2, 3),
    ],
)
def test_impossible_weights_are_refused(weights):
    with pytest.raises(InputError) as caught:
        lc.compile([hybrid(), hybrid(1)], weights=weights)
    weight_list = ", ".join(f"{weight:g}" for weight in weights)
    assert str(caught.value) == (
        "weights: each network needs one above 0, at most 1,000,000 times any other "
        f"({weight_list} for 2 networks). Give numbers such as 1,2."
    )


@pytest.mark.parametrize(
    ("networks", "types"),
    [([], "none"), (["a.pt", "b.pt"], "str, str"), ([hybrid(), None], "Network, NoneType")],
    ids=["nothing", "paths", "one network"],
)
def test_a_list_of_anything_but_networks_is_refused(networks, types):
    with pytest.raises(InputError) as caught:
        lc.compile(networks)
    assert str(caught.value) == (
        f"networks: they are not networks (got {types}). Read each with lc.load."
    )


def test_weights_of_a_single_network_are_refused():
    with pytest.raises(InputError) as caught:
        lc.compile(hybrid(), weights=(1,))
    assert str(caught.value) == "weights: they apply only to several networks. Leave them out."


def test_a_program_of_several_is_saved_and_loaded(tmp_path):
    levels = lower(committee(three(), (1, 0.3, 2)), CHIP, weight_bits=8)
    levels.program.save(tmp_path)
    played = recordings(levels.network)
    loaded = hw.load_program(tmp_path)
    scores = hw.simulate(levels.program, played).scores
    assert np.array_equal(hw.simulate(loaded, played).scores, scores)
    document = yaml.safe_load((tmp_path / "program.yaml").read_text())
    assert all(weight == int(weight) for weight in document["readout"].values())


@pytest.mark.parametrize("kind", ["nir", "net"])
def test_formats_of_one_network_refuse_several(kind):
    with pytest.raises(InputError) as caught:
        exchange_file(kind, lower(committee(three(), (1, 1, 1)), CHIP, weight_bits=8).quantized)
    assert (
        str(caught.value) == f"--emit {kind}: the format cannot hold a committee. Emit without it."
    )
