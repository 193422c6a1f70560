"""``locsnn events --encode``: numbers become spikes, and the command prints what is lost.

Spikes and errors are compared with numbers worked out by hand or by the encoder's own function.
"""

import json

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data.encoders import rate_spikes


def test_latency_writes_a_spike_for_each_number(tmp_path, capsys):
    np.savez(tmp_path / "values.npz", values=[[1.0, 0.5, 0.04]], labels=[2], step_seconds=0.01)
    options = ["--encode", "latency", "--steps", "11", "--to", str(tmp_path / "spikes.npz")]
    assert main(["events", str(tmp_path / "values.npz"), *options]) == 0
    written = lc.read_recordings(tmp_path / "spikes.npz")
    assert np.argwhere(written.spikes[0]).tolist() == [[0, 0], [5, 1], [10, 2]]
    assert (written.labels.tolist(), written.step_seconds) == ([2], 0.01)
    # 0.04 is decoded as 0: the root of 0.04^2 / 3.
    assert (
        "encoded by latency: decoded numbers are off by 0.0231 (root mean square) and 0.04 at most\n"
        in capsys.readouterr().out
    )


def test_rates_are_drawn_by_the_seed(tmp_path, capsys):
    values = np.random.default_rng(0).random((3, 2, 4))
    np.save(tmp_path / "values.npy", values)
    options = ["--encode", "rate", "--steps", "50", "--seed", "7", "--json"]
    output_options = ["--to", str(tmp_path / "spikes.npy")]
    assert main(["events", str(tmp_path / "values.npy"), *options, *output_options]) == 0
    expected = rate_spikes(values.reshape(3, 8), 50, seed=7)
    np.testing.assert_array_equal(
        lc.read_recordings(tmp_path / "spikes.npy").spikes, expected.spikes
    )
    encoding = json.loads(capsys.readouterr().out)["encoding"]
    assert encoding["encoder"] == "rate"
    means = expected.spikes.mean(axis=1)
    assert encoding["largest_error"] == pytest.approx(np.abs(means - values.reshape(3, 8)).max())


def test_levels_take_signals(tmp_path, capsys):
    np.save(tmp_path / "signal.npy", np.array([[[0.0], [0.6], [1.1], [0.4]]]))
    options = ["--encode", "levels", "--level", "0.5", "--to", str(tmp_path / "spikes.npz")]
    assert main(["events", str(tmp_path / "signal.npy"), *options]) == 0
    spikes = lc.read_recordings(tmp_path / "spikes.npz").spikes[0]
    assert spikes.tolist() == [[0, 0], [0, 1], [0, 1], [1, 0]]


REFUSED = {
    "a seed without numbers": (
        ["--seed", "1"],
        "--seed: no numbers are encoded. Add --encode with a FILE of numbers.",
    ),
    "rate without steps": (["--encode", "rate"], "--encode rate: it needs --steps. Add --steps."),
    "a level of rates": (
        ["--encode", "rate", "--steps", "5", "--level", "1"],
        "--level: the encoder rate has none. Leave it out.",
    ),
    "a grid": (
        ["--encode", "latency", "--steps", "5", "--grid", "2x2"],
        "--grid: it describes recordings of events, and --encode takes arrays of numbers. Leave it "
        "out.",
    ),
    "numbers that are no shares": (
        ["--encode", "latency", "--steps", "5"],
        "values: one is out of range (2). Scale them to 0..1.",
    ),
    "levels without steps": (
        ["--encode", "levels", "--level", "1"],
        "values 'values.npy': they have no axis of steps (shape (1, 2)). Give (samples, steps, "
        "signals).",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_options_that_do_not_fit_are_refused(case, tmp_path, monkeypatch, capsys):
    options, message = REFUSED[case]
    monkeypatch.chdir(tmp_path)
    np.save("values.npy", np.array([[2.0, 0.5]]))
    assert main(["events", "values.npy", *options]) == 2
    assert capsys.readouterr().err == f"{message}\n"
