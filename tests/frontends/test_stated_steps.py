"""The step that another tool's file states is used if neither the recordings nor the user state how long a step lasts."""

import json

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from tests.support.slayer_files import LOIHI, write

RNG = np.random.default_rng(0)


@pytest.fixture
def network(tmp_path):
    """A network whose description states a ``Ts`` of 1 ms."""
    network = lc.load(*write(tmp_path, {"fc1": RNG.normal(1, 2, (3, 6))}, neuron=LOIHI))
    assert (network.step_seconds, network.usual_step_seconds) == (None, 0.001)
    return network


def bins(step_seconds):
    """Return two recordings of 50 steps."""
    spikes = (RNG.random((2, 50, 6)) < 0.2).astype(np.uint8)
    return Recordings(spikes, labels=None, step_seconds=step_seconds, source="bins")


AS_STATED = "A step lasts 0.001 s, as the model states it, unless --step-seconds gives another."
AS_RECORDED = "A step lasts 0.02 s, like the bins of the recordings; the model states 0.001 s."


@pytest.mark.parametrize(
    ("step_seconds", "recording_ns", "sentence"),
    [(None, 50e6, AS_STATED), (0.001, 50e6, AS_STATED), (0.02, 1e9, AS_RECORDED)],
)
def test_recordings_override_the_step_that_a_file_states(
    network, step_seconds, recording_ns, sentence
):
    compiled = lc.compile(network, events=bins(step_seconds), diagnosis=False)
    assert compiled.report["latency"]["recording_ns"] == pytest.approx(recording_ns)
    assert sentence in compiled.report["assumptions"]
    assert compiled.program.step_seconds == (step_seconds or 0.001)


def test_events_are_binned_in_the_steps_that_a_file_states(network, tmp_path):
    # Times are in microseconds: the last event is in the sixth millisecond.
    events = np.array([(0, 0, 0), (5_400, 5, 0)], dtype=[("t", "i8"), ("x", "i8"), ("p", "i1")])
    np.save(tmp_path / "a.npy", events)
    expected = network.expected
    recordings = read_recordings(tmp_path / "a.npy", model=expected, polarities=1)
    assert (recordings.spikes.shape, recordings.step_seconds) == ((1, 6, 6), 0.001)
    recordings = read_recordings(
        tmp_path / "a.npy", model=expected, polarities=1, step_seconds=0.002
    )
    assert (recordings.spikes.shape, recordings.step_seconds) == ((1, 3, 6), 0.002)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "seconds"),
    [
        pytest.param([], 0.325, id="as stated"),
        pytest.param(["--step-seconds", "0.02"], 6.5, id="given"),
    ],
)
def test_the_authors_hybrid_lasts_as_long_as_asked_without_events(options, seconds, tmp_path):
    """325 steps of the paper's sensor are 6.5 s, although its YAML has Ts: 1."""
    layers = {
        "fc1": RNG.normal(0.1, 2, (6, 156)),
        "fc2": RNG.normal(1, 2, (3, 6)),
        "locationFc1": RNG.normal(0.1, 2, (6, 325)),
        "locationFc2": RNG.normal(1, 2, (3, 6)),
    }
    model, config = write(tmp_path, layers, steps=325)
    command = [str(model), "--config", str(config), "--strategy", "dendrite", *options]
    assert compile_main([*command, "-o", str(tmp_path / "out"), "--quiet"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["latency"]["recording_ns"] == pytest.approx(seconds * 1e9)
