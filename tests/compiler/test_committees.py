"""Several networks in one program: scores, cores, phases, the report, and files that hold several."""

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


def members(seed, events, first):
    """Two integer networks of one input and as many classes, aligned each in its own way, read out each in its own."""
    plain = [without_biases(on_grid(seed + number, channels=5, steps=20)) for number in range(2)]
    sizes = set.intersection(*({p.size for p in network.populations} for network in plain))
    assume(sizes)
    made = []
    for number, (network, (time, location)) in enumerate(zip(plain, events, strict=True)):
        read = tuple(p.name for p in network.populations if p.size == max(sizes))
        readout = Readout(read, (1.0,) * len(read), first[number])
        made.append(replace(aligned(network, time, location), name=f"m{number}", readout=readout))
    return made


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    events=st.tuples(st.tuples(EVENTS, EVENTS), st.tuples(EVENTS, EVENTS)),
    first=st.tuples(*[st.sampled_from([None, 0, 3])] * 2),
    weights=st.tuples(*[st.sampled_from([1.0, 2.0, 0.37, 5.3])] * 2),
)
def test_scores_are_the_weighted_sum_on_every_side(seed, events, first, weights):
    networks = members(seed, events, first)
    joined = committee(networks, weights)
    played = late(recordings(joined, samples=4, seed=seed), seed)
    alone = [evaluate(network, played) for network in networks]
    wanted = sum(w * its.scores for w, its in zip(weights, alone, strict=True))
    found = evaluate(joined, played)
    assert np.allclose(found.scores, wanted, rtol=1e-12)
    for network, its in zip(networks, alone, strict=True):
        for p in network.populations:
            assert np.array_equal(found.spikes[f"{network.name}/{p.name}"], its.spikes[p.name])
    levels = lower(joined, CHIP, weight_bits=8)
    assert all(weight.is_integer() for weight in levels.program.readout.weights)
    match = compare(Observed(levels, played))
    assert match.spikes.mismatches == 0
    slow = hw.simulate(levels.program, played, engine="reference")
    assert np.array_equal(slow.scores, evaluate(levels.quantized.on_grid(), played).scores)
    assert np.array_equal(slow.scores, hw.simulate(levels.program, played).scores)
    ratio = [s for s in (slow.scores / np.where(wanted, wanted, 1)).ravel().tolist() if s]
    assert not ratio or max(ratio) / min(ratio) < 1.01
    for one, scores in zip(played, slow.scores, strict=True):
        assert np.array_equal(hw.Session(levels.program).push(one).scores[-1], scores)
    stops = hw.stop_when_proven(levels.program, played)
    assert np.array_equal(stops.prediction, slow.prediction)


def test_scores_that_do_not_vary_are_added_as_they_are():
    """A spread of 0 counted as 1, and scores were said to vary alike."""
    networks = [hybrid(0), replace(hybrid(1), name="other")]
    silent = np.zeros((2, networks[0].steps, networks[0].channels), np.uint8)
    joined = join(networks, calibration=silent)
    assert [member.weight for member in joined.members] == [1.0, 1.0]
    said = f"Class scores of {networks[0].name} and other are equal on array: scores are added as they are (--weights)."
    assert joined.assumptions[-1] == said


def three():
    """Two that play alike, and one that is aligned: hybrids of one input."""
    one, two, late = (
        replace(hybrid(seed, scale=20.0), name=name)
        for seed, name in enumerate(("one", "two", "late"))
    )
    return [one, two, aligned(late)]


def test_equal_inputs_and_phases_are_shared_and_no_core_is():
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
    on_core = [{piece.group.split("/")[0] for piece in core.slices} for core in program.cores]
    assert sorted(on_core, key=min) == [{"late"}] * 2 + [{"one"}] * 2 + [{"two"}] * 2


def test_members_cost_what_they_cost_alone():
    """Their neurons and synapses; what brings events to them is shared. Side by side takes no longer than the slowest."""
    networks = [
        replace(hybrid(seed, scale=20.0, channels=4), name=name) for seed, name in enumerate("ab")
    ]
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
        its = [found["pj"] for found in alone.report["energy"]["by_population_pj"].values()]
        assert row["cores"] == alone.report["resources"]["cores"] == 2
        assert row["per_sample_pj"] == pytest.approx(sum(its))
        assert row["per_sample_ns"] == pytest.approx(alone.report["latency"]["per_sample_ns"])
        assert (row["name"], row["sha256"], row["weight"]) == (
            network.name,
            "0" * 64,
            1.0 if network.name == "a" else 3.0,
        )
    slowest = max(row["per_sample_ns"] for row in rows)
    assert (
        slowest
        <= both.report["latency"]["per_sample_ns"]
        < sum(row["per_sample_ns"] for row in rows)
    )
    page = render_markdown(compose(both.figures))
    assert "a: " in page
    assert "2 cores, class scores times 3" in page
    assert both.report["resources"]["cores"] == 4


def test_on_an_open_core_no_member_has_a_time_of_its_own():
    """One core hosts them all, one after the other; 0 pJ and the time of a barrier stood there."""
    networks = [
        replace(hybrid(seed, scale=20.0, channels=4), name=name) for seed, name in enumerate("ab")
    ]
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


def test_without_weights_scores_vary_alike():
    networks = [
        replace(hybrid(seed, scale=scale, steps=40), name=name)
        for seed, scale, name in ((1, 30.0, "a"), (2, 9.0, "b"))
    ]
    carried = Recordings(
        recordings(networks[0], samples=6),
        labels=None,
        step_seconds=0.02,
        source="few.pt",
        origin="carried",
    )
    plain, found = join(networks), join([replace(networks[0], recordings=carried), networks[1]])
    assert [member.weight for member in plain.members] == [1.0, 1.0]
    assert plain.assumptions == ("Class scores of the networks are added as they are (--weights).",)
    spreads = [evaluate(network, carried.spikes).scores.std(axis=1).mean() for network in networks]
    assert found.members[1].weight == pytest.approx(spreads[0] / spreads[1])
    assert found.assumptions[0].startswith(
        "Class scores vary alike on 6 recordings of few.pt: weights a 1, b "
    )
    assert join(networks, calibration=carried).members == found.members


def other(**changes):
    return [hybrid(), replace(hybrid(1), name="other", **changes)]


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
            [
                replace(
                    hybrid(), sensor=asked_layout("2x2", polarities=1, channels=None, layout=None)
                ),
                other(sensor=neutouch())[1],
            ],
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
def test_weights_that_are_refused(weights):
    with pytest.raises(InputError) as caught:
        lc.compile([hybrid(), hybrid(1)], weights=weights)
    given = ", ".join(f"{w:g}" for w in weights)
    what = "each network needs one above 0, at most 1,000,000 times any other"
    assert (
        str(caught.value) == f"weights: {what} ({given} for 2 networks). Give numbers such as 1,2."
    )


@pytest.mark.parametrize(
    ("networks", "given"),
    [([], "none"), (["a.pt", "b.pt"], "str, str"), ([hybrid(), None], "Network, NoneType")],
)
def test_what_is_not_a_network_is_refused(networks, given):
    with pytest.raises(InputError) as caught:
        lc.compile(networks)
    assert (
        str(caught.value)
        == f"networks: they are not networks (got {given}). Read each with lc.load."
    )


def test_one_network_has_nothing_to_weigh():
    with pytest.raises(InputError) as caught:
        lc.compile(hybrid(), weights=(1,))
    assert str(caught.value) == "weights: they apply only to several networks. Leave them out."


def test_a_program_of_several_is_saved_and_loaded(tmp_path):
    levels = lower(committee(three(), (1, 0.3, 2)), CHIP, weight_bits=8)
    levels.program.save(tmp_path)
    played = recordings(levels.network)
    loaded = hw.load_program(tmp_path)
    assert np.array_equal(
        hw.simulate(loaded, played).scores, hw.simulate(levels.program, played).scores
    )
    assert all(
        w == int(w)
        for w in yaml.safe_load((tmp_path / "program.yaml").read_text())["readout"].values()
    )


@pytest.mark.parametrize("kind", ["nir", "net"])
def test_formats_of_one_network_refuse_several(kind):
    with pytest.raises(InputError) as caught:
        exchange_file(kind, lower(committee(three(), (1, 1, 1)), CHIP, weight_bits=8).quantized)
    assert (
        str(caught.value) == f"--emit {kind}: the format cannot hold a committee. Emit without it."
    )
