"""Transposed inputs that visit several channels in one step: both engines agree, files hold them, bad files are refused.

The documented file format is read by a few lines of the test's own, without the package.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.io.files import pack_arrays
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import CompartmentGraph, Input, Phase, read_only
from hw_model.program.write import program_files
from tests.support.hybrids import random_hybrid


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    channels_per_step=st.integers(1, 4),
    silence=st.integers(0, 3),
    extra=st.integers(0, 3),
)
def test_both_engines_give_the_same(seed, channels_per_step, silence, extra):
    program, recording = random_hybrid(seed, channels_per_step, silence)
    # There are more rows than lines, and one recording of the batch is silent.
    rows = np.pad(recording, ((0, extra), (0, 0)), constant_values=1)
    batch = np.stack((rows, np.zeros_like(rows), rows[::-1]))
    probe = ("spikes", "u", "v", "potential", "activity")
    fast, slow = (
        hw.simulate(program, batch, engine=engine, probe=probe) for engine in ("fast", "reference")
    )
    assert replace(fast.counts, skipped_steps=0) == slow.counts
    for kind in ("spikes", "u", "v", "potential"):
        for name, expected in getattr(slow, kind).items():
            assert np.array_equal(getattr(fast, kind)[name], expected), (kind, name)
    for phase, items in slow.activity.items():
        for fast_activity, expected in zip(fast.activity[phase], items, strict=True):
            assert np.array_equal(fast_activity.buffered, expected.buffered)
            assert np.array_equal(fast_activity.input_packets, expected.input_packets)
    location = slow.counts_by_phase["location"]
    assert (location.transpose_events, location.events_dropped) == (
        batch[:, : len(recording)].sum(),
        batch[:, len(recording) :].sum(),
    )
    assert len(slow.activity["location"][0].buffered) == program.phases[1].steps


def test_events_of_visits_after_the_last_step_are_dropped():
    program, recording = random_hybrid(4, channels_per_step=2)
    recording = np.ones_like(recording)
    shorter = replace(program, phases=(program.phases[0], replace(program.phases[1], steps=2)))
    counts = hw.simulate(shorter, recording).counts_by_phase["location"]
    assert counts == replace(
        hw.simulate(shorter, recording, engine="reference").counts_by_phase["location"],
        skipped_steps=counts.skipped_steps,
    )
    assert recording.shape[1] > 4
    assert counts.transpose_events == 4 * len(recording)
    assert counts.events_dropped == recording.sum() - 4 * len(recording)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), channels_per_step=st.integers(2, 4))
def test_a_loaded_program_plays_what_the_saved_one_does(seed, channels_per_step, tmp_path_factory):
    folder = tmp_path_factory.mktemp("program")
    program, recording = random_hybrid(seed, channels_per_step, silence=1)
    program.save(folder)
    loaded = hw.load_program(folder)
    assert program_files(loaded) == program_files(program)
    before, after = (hw.simulate(p, recording) for p in (program, loaded))
    assert before.counts == after.counts
    assert np.array_equal(before.scores, after.scores)


@pytest.fixture
def saved(tmp_path):
    """A folder with a saved program that visits two channels per step."""
    program, _ = random_hybrid(4, channels_per_step=2)
    program.save(tmp_path)
    return tmp_path


def test_only_visits_together_make_an_array_of_first_lines(saved, tmp_path_factory):
    apart = tmp_path_factory.mktemp("apart")
    random_hybrid(4)[0].save(apart)
    for folder, has_array in ((saved, True), (apart, False)):
        with np.load(folder / "program.npz") as arrays:
            assert ("input1/first_lines" in arrays.files) == has_array
            assert "input1/positions" in arrays.files


def test_a_reader_that_knows_only_the_page_plays_the_lines(saved):
    """The files alone say how many events each input axon of a core gets in every step of the location phase."""
    page = (Path(__file__).parents[2] / "docs/reference/program-format.md").read_text()
    assert {"positions", "first_lines"} <= set(re.findall(r"`([a-z_0-9]+)`", page))
    program, recording = random_hybrid(4, channels_per_step=2)
    document = yaml.safe_load((saved / "program.yaml").read_text())
    arrays = dict(np.load(saved / "program.npz"))
    steps = {phase["name"]: phase["steps"] for phase in document["phases"]}
    item = document["inputs"][1]
    assert item["transposed"]
    positions = arrays["input1/positions"]
    first_lines = arrays["input1/first_lines"]
    packets = np.zeros(steps[item["phase"]], dtype=np.int64)
    for t, c in np.argwhere(recording):
        if t < item["size"] - first_lines.max() and positions[c] < len(packets):
            packets[positions[c]] += (arrays["input1/line"] == first_lines[c] + t).sum()
    activity = hw.simulate(program, recording, probe=("activity",)).activity["location"][0]
    assert np.array_equal(packets, activity.input_packets.sum(axis=1))
    assert packets.any()


BROKEN = "input 'location/x': its {} do not make a program. Compile it again."
# What is changed in the arrays of a program, and the message.
CHANGES = [
    ("a step after the last", lambda a: a | {"input1/positions": a["input1/positions"] + 1}, BROKEN.format("positions")),
    ("a step before the first", lambda a: a | {"input1/positions": a["input1/positions"] - 1}, BROKEN.format("positions")),
    ("no line of the input", lambda a: a | {"input1/first_lines": a["input1/first_lines"] + 2**40}, BROKEN.format("first lines")),
    ("a line before the first", lambda a: a | {"input1/first_lines": a["input1/first_lines"] - 1}, BROKEN.format("first lines")),
    ("lines of two", lambda a: a | {"input1/first_lines": a["input1/first_lines"] // 2}, BROKEN.format("first lines")),
    ("one step for all", lambda a: a | {"input1/positions": 0 * a["input1/positions"]}, BROKEN.format("first lines")),
    ("no first lines", lambda a: {name: array for name, array in a.items() if name != "input1/first_lines"}, BROKEN.format("first lines")),
    ("too few", lambda a: a | {"input1/first_lines": a["input1/first_lines"][1:]}, BROKEN.format("first lines")),
    ("of what comes as it is", lambda a: a | {"input0/first_lines": np.zeros(8, dtype=np.int64)}, BROKEN.replace("location", "time").format("first lines")),
    ("another number of channels", lambda a: a | {"input1/positions": a["input1/positions"][1:], "input1/first_lines": a["input1/first_lines"][1:]}, BROKEN.replace("location", "time").format("channels")),
]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"), [row[1:] for row in CHANGES], ids=[row[0] for row in CHANGES]
)
def test_visits_that_no_program_has_are_refused(saved, change, message):
    with np.load(saved / "program.npz") as arrays:
        content = pack_arrays(change(dict(arrays)), compressed=False)
    (saved / "program.npz").write_bytes(content)
    text = (saved / "program.yaml").read_text()
    digest = hashlib.sha256(content).hexdigest()
    (saved / "program.yaml").write_text(
        re.sub("arrays_sha256: .*", f"arrays_sha256: {digest}", text)
    )
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("positions", "first_lines", "message"),
    [
        ([0, 1, 3], None, "input 'x': a channel is visited outside its phase (step 3 of 3, counted from 0). Give the phase more steps."),
        ([0, -1, 2], None, "input 'x': a channel is visited outside its phase (step -1 of 3, counted from 0). Give the phase more steps."),
        ([0, 0, 1], [0, 3], "input 'x': its first lines do not fit (2 within 0..3 against 3 within 0..5). Give one per channel."),
        ([0, 0, 1], [0, 6, 0], "input 'x': its first lines do not fit (3 within 0..6 against 3 within 0..5). Give one per channel."),
        ([0, 0, 1], [0, 1, 5], None),
        ([0, 0, 1], [0, 1, 4], "input 'x': two channels of one step share lines. Give each lines of its own."),
        ([0, 0, 1], None, "input 'x': two channels of one step share lines. Give each lines of its own."),
        ([0, 0, 1], [3, 0, 0], None),
    ],
)  # fmt: skip
def test_visits_must_fit_the_steps_and_lines_of_their_phase(positions, first_lines, message):
    lines = None if first_lines is None else read_only(first_lines)
    item = Input(
        "x",
        size=6,
        phase="location",
        stream="touch",
        positions=read_only(positions),
        first_lines=lines,
    )
    graph = CompartmentGraph(
        name="visits",
        phases=(Phase("location", "location", steps=3),),
        inputs=(item,),
        groups=(),
        synapses=(),
    )
    if message is None:
        check_graph(graph, hw.chip("loihi-sim"))
        return
    with pytest.raises(hw.InputError) as caught:
        check_graph(graph, hw.chip("loihi-sim"))
    assert str(caught.value) == message
