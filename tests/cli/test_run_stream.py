"""``locsnn run --stream`` and ``--stop``: step by step, and stopped early.

What the command prints is compared with the functions of ``hw_model`` that compute the same for all
steps at once (``timestep_scores``, ``stop_when_proven``, ``stop_at_margin``), from which changes of
the prediction are found here once more, in plain Python.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.program.sealed import SEAL
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main
from locsnn_compile.cli.outcomes import Change, StepLatency, StreamFigures
from locsnn_compile.cli.run_stream import (
    LiveLine,
    Streamed,
    lead_text,
    right_over_time,
    step_latency,
    stream_lines,
)

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"

# Sizes of the model: 39 taxels of two polarities, and 250 steps of 0.02 s for its time branch. The
# location branch then takes a step for each channel.
CHANNELS = 78
CLASSES = 36
STEP_SECONDS = 0.02
TIME_STEPS = 250
ALL_STEPS = TIME_STEPS + CHANNELS

FEW = 3
"""Recordings that are played."""
MORE = 6
"""Recordings on which margins are calibrated."""
RECORDED_STEPS = 60
"""Steps of all recordings here: silence follows them until step 250."""
PSI = 3.0
"""Of the build, for the time-weighted prediction in its report."""


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A folder with a build (out) and recordings: few and more with labels, and silent ones."""
    folder = tmp_path_factory.mktemp("build")
    rng = np.random.default_rng(0)
    for name, samples in (("few", FEW), ("more", MORE)):
        spikes = rng.random((samples, CHANNELS, RECORDED_STEPS)) < 0.1
        np.save(folder / f"{name}.npy", spikes.astype(np.uint8))
        np.save(folder / f"{name}_labels.npy", np.arange(samples))
    np.save(folder / "silent.npy", np.zeros((2, CHANNELS, RECORDED_STEPS), dtype=np.uint8))
    options = f"--quiet --strategy dendrite --psi {PSI:g}".split()
    arguments = [MODEL, "--events", folder / "few.npy", "-o", folder / "out", *options]
    assert compile_main([str(argument) for argument in arguments]) == 0
    return folder


@pytest.fixture(scope="module")
def program(build):
    """The program that the build wrote."""
    return hw.load_program(build / "out")


def spikes(build, name="few"):
    """Recordings (samples, steps, channels) of a file of the build, which holds (samples, channels, steps)."""
    return np.load(build / f"{name}.npy").transpose(0, 2, 1)


def run(build, *arguments):
    """Run ``locsnn run`` on the build's program and its few recordings; return the exit code."""
    return main(
        ["run", str(build / "out"), "--events", str(build / "few.npy"), *map(str, arguments)]
    )


def as_json(build, capsys, *arguments):
    """What ``locsnn run --json`` prints."""
    assert run(build, *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out)


def changes(scores):
    """The changes of the prediction by scores (steps, classes), from the first lead on, as JSON has them."""
    changes_so_far = []
    prediction = None
    for step, row in enumerate(scores, start=1):
        best, second = sorted(row.tolist(), reverse=True)[:2]
        if prediction is None and best == second:
            continue
        if row.argmax() != prediction:
            prediction = int(row.argmax())
            change = {"step": step, "prediction": prediction, "lead": best - second}
            changes_so_far.append(change)
    return changes_so_far


@pytest.mark.slow
@pytest.mark.parametrize("psi", [None, 10.0], ids=["plain", "time-weighted"])
def test_json_has_every_change_of_the_prediction(build, program, capsys, psi):
    psi_options = () if psi is None else ("--psi", psi)
    document = as_json(build, capsys, "--stream", *psi_options)
    scores = hw.timestep_scores(program, spikes(build), psi)
    assert scores.shape == (FEW, TIME_STEPS, CLASSES)
    for row, scores_of_recording in zip(document["recordings"], scores, strict=True):
        assert row["changes"] == changes(scores_of_recording)
        assert row["changes"][-1]["prediction"] == row["prediction"]
    stream = document["stream"]
    assert stream["psi"] == psi
    assert stream["step_seconds"] == pytest.approx(STEP_SECONDS)
    assert stream["right_is"] == "the label"
    is_right = scores.argmax(axis=2) == np.arange(FEW)[:, None]
    assert stream["right"] == is_right.mean(axis=0).tolist()
    latency = stream["step_latency_seconds"]
    assert 0 < latency["mean"] <= latency["worst"]
    assert latency["p99"] <= latency["worst"]
    assert stream["real_time_factor"] == pytest.approx(STEP_SECONDS / latency["mean"])
    assert stream["worst_real_time_factor"] == pytest.approx(STEP_SECONDS / latency["worst"])


@pytest.mark.slow
def test_lines_change_only_with_the_prediction(build, program, capsys):
    assert run(build, "--stream") == 0
    lines = iter(capsys.readouterr().out.splitlines())
    for recording, scores in enumerate(hw.timestep_scores(program, spikes(build))):
        changes_of_recording = changes(scores)
        for change in changes_of_recording:
            seconds = f"{change['step'] * STEP_SECONDS:.2f} s"
            assert next(lines) == (
                f"recording {recording}  step {change['step']} of {TIME_STEPS}  {seconds}  "
                f"class {change['prediction']}  lead {change['lead']:.3g}"
            )
        last = changes_of_recording[-1]
        assert next(lines) == (
            f"recording {recording}: class {last['prediction']}  label {recording}  since step {last['step']}"
        )
    assert next(lines).startswith("accuracy 0.")
    assert next(lines).startswith("mean per recording: ")
    assert re.fullmatch(r"accuracy over time: (0\.\d{3} after \d\.00 s(, )?){5}", next(lines))
    assert re.fullmatch(
        r"a step took [\d.]+ [µm]s on average, 99 % of them at most [\d.]+ [µm]s, the longest [\d.]+ [µm]s; "
        r"at the sensor it takes 20.0 ms: [\d.,]+ times as fast as real time, [\d.,]+ times in the longest step",
        next(lines),
    )
    assert next(lines, None) is None


@pytest.mark.slow
def test_the_length_of_a_step_comes_from_an_option_or_is_left_out(build, capsys, tmp_path):
    assert run(build, "--stream", "--step-seconds", 0.5) == 2
    refused = (
        "step_seconds: program 'objects-hybrid' has another (got 0.5 against 0.02). Leave it out.\n"
    )
    assert capsys.readouterr() == ("", refused)
    # A program that does not state the length; without the checksum at the end, it may be changed.
    text = (build / "out/program.yaml").read_text().replace("step_seconds: 0.02\n", "")
    (tmp_path / "program.yaml").write_text(text.rpartition(SEAL)[0])
    (tmp_path / "program.npz").write_bytes((build / "out/program.npz").read_bytes())
    silent = ["run", str(tmp_path), "--events", str(build / "silent.npy"), "--stream"]
    assert main([*silent, "--step-seconds", "0.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stream"]["step_seconds"] == 0.5
    assert main(silent) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "recording 0: all classes tie"
    # Fifths of the 250 steps.
    assert lines[-2] == "already the last prediction: " + ", ".join(
        f"1.000 after step {step}" for step in (50, 100, 150, 200, 250)
    )
    assert lines[-1].endswith(
        "; the length of a step at the sensor is not known: give --step-seconds"
    )


@pytest.mark.slow
def test_where_all_classes_tie_the_label_is_not_predicted(build, capsys, tmp_path):
    silent = tmp_path / "silent_label_0.npy"
    np.save(silent, np.load(build / "silent.npy")[:1])
    assert main(["run", str(build / "out"), "--events", str(silent), "--stream"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "accuracy 0.000 on 1 recording"
    assert lines[3] == "accuracy over time: " + ", ".join(
        f"0.000 after {second}.00 s" for second in range(1, 6)
    )


def test_lines_of_the_summary():
    figures = StreamFigures(
        psi=None,
        step_seconds=0.02,
        step_latency_seconds=StepLatency(mean=0.0001, p99=0.0004, worst=0.04),
        real_time_factor=200.0,
        worst_real_time_factor=0.5,
        right_is="the label",
        right=(0.0, 0.25, 0.5, 0.5, 1.0),
    )
    assert stream_lines(figures) == [
        "accuracy over time: 0.000 after 0.02 s, 0.250 after 0.04 s, 0.500 after 0.06 s, 0.500 after 0.08 s, "
        "1.000 after 0.10 s",
        "a step took 100 µs on average, 99 % of them at most 400 µs, the longest 40.0 ms; at the sensor it takes 20.0 ms: "
        "200 times as fast as real time, 0.500 times in the longest step",
    ]


def test_the_report_follows_predictions_with_a_psi(build, program, capsys):
    entry = json.loads((build / "out/report.json").read_text())["over_time"]
    scores = hw.timestep_scores(program, spikes(build), PSI)
    shares = (scores.argmax(axis=2) == np.arange(FEW)[:, None]).mean(axis=0)
    # The report has every fifth step.
    assert (entry["psi"], entry["steps"]) == (PSI, list(range(5, TIME_STEPS + 1, 5)))
    assert entry["right"]["time_weighted"] == shares[4::5].tolist()
    assert compile_main([str(MODEL), "--psi", "inf"]) == 2
    assert capsys.readouterr().err == "--psi inf: it is out of range. Give a number from 0 up.\n"


def test_proven_stops(build, program, capsys):
    document = as_json(build, capsys, "--stop", "proven")
    stops = hw.stop_when_proven(program, spikes(build))
    stop = document["stop"]
    assert stop["kind"] == "proven"
    assert stop["agreement"] == 1.0
    assert stop["all_steps"] == ALL_STEPS
    assert stop["recordings"] == FEW
    rows = document["recordings"]
    assert [row["stop"]["step"] for row in rows] == stops.steps.tolist()
    # A proven class is the one after the last step.
    assert [row["stop"]["prediction"] for row in rows] == [row["prediction"] for row in rows]
    assert stop["all_synaptic_ops"] == document["counts"]["synaptic_ops"] / FEW
    assert stop["all_energy_pj"] == pytest.approx(sum(document["energy_pj"].values()) / FEW)
    assert stop["synaptic_ops"] == stops.counts.synaptic_ops / FEW
    assert stop["profile"] == "davies2018"
    assert run(build, "--stop", "proven") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == [
        "recording 0",
        "recording 1",
        "recording 2",
    ]
    assert re.fullmatch(
        rf"stopped \(proven\) after \d+ of {ALL_STEPS} steps on average; saved [\d.]+ % of the steps, "
        r"[\d.]+ % of the synaptic operations, [\d.]+ % of the energy; "
        r"[\d.]+ µJ instead of [\d.]+ µJ, and [\d.]+ [µm]s instead of [\d.]+ [µm]s \(profile davies2018\)",
        lines[-2],
    )
    accuracy = stop["whole_accuracy"]
    assert lines[-1] == (
        f"same prediction as the whole recording in 100 % of 3 recordings; accuracy {accuracy:.3f} instead of {accuracy:.3f}"
    )


def test_stops_in_silence(build, program, capsys):
    silent_steps = 9
    silence = np.zeros((FEW, TIME_STEPS - RECORDED_STEPS, CHANNELS), dtype=np.uint8)
    until_the_end = np.concatenate((spikes(build), silence), axis=1)
    stops = hw.stop_in_silence(program, until_the_end, silent_steps)
    stop = as_json(build, capsys, "--stop", "silence", "--silence", silent_steps)["stop"]
    assert stop["kind"] == "silence"
    assert stop["steps"] == stops.steps.mean()
    assert stop["all_steps"] == TIME_STEPS
    # Not before the events have ended and the silence has lasted, and the program is at rest.
    assert RECORDED_STEPS + silent_steps < stop["steps"] < TIME_STEPS
    assert stop["latency_ns"] == pytest.approx(stops.latency_ns / FEW)
    assert stop["all_latency_ns"] == pytest.approx(stops.all_latency_ns / FEW)
    report = json.loads((build / "out/report.json").read_text())
    assert stop["all_latency_ns"] == pytest.approx(report["latency"]["per_sample_ns"])
    assert stop["latency_ns"] < stop["all_latency_ns"]
    assert stop["energy_pj"] < stop["all_energy_pj"]
    assert stop["agreement"] == 1.0
    assert run(build, "--stop", "silence", "--silence", silent_steps) == 0
    assert capsys.readouterr().out.splitlines()[-2].startswith("stopped (silence) after ")


@pytest.mark.slow
@pytest.mark.parametrize("psi", [None, 10.0], ids=["plain", "time-weighted"])
def test_a_calibrated_margin(build, program, capsys, psi):
    psi_options = () if psi is None else ("--psi", psi)
    calibration = ("--calibrate", build / "more.npy", "--min-agreement", 0.5)
    options = ("--stop", "margin", *calibration, *psi_options)
    document = as_json(build, capsys, "--stream", *options)
    margin = hw.calibrate_margin(program, spikes(build, "more"), 0.5, psi)
    stops = hw.stop_at_margin(program, spikes(build), margin, psi)
    stop = document["stop"]
    assert (stop["kind"], stop["margin"], stop["all_steps"]) == ("margin", margin, TIME_STEPS)
    assert stop["steps"] == stops.steps.mean() < TIME_STEPS
    assert stop["agreement"] == (stops.prediction == stops.final).mean()
    assert stop["accuracy"] == (stops.prediction == np.arange(FEW)).mean()
    calibrated_on = dict(stop["calibrated_on"])
    assert calibrated_on.pop("agreement") >= 0.5
    assert calibrated_on == {
        "source": "more.npy",
        "part": None,
        "recordings": MORE,
        "min_agreement": 0.5,
    }
    scores = hw.timestep_scores(program, spikes(build), psi)
    by_recording = zip(document["recordings"], stops.steps, scores, strict=True)
    for row, step, scores_of_recording in by_recording:
        prediction = int(scores_of_recording[step - 1].argmax())
        assert row["stop"] == {"step": step, "prediction": prediction}
        assert row["changes"] == changes(scores_of_recording[:step])
    assert run(build, "--stream", *options) == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        f"margin: a lead of {margin:.4g} is enough for 50.0 % agreement on 6 recordings of more.npy"
        in lines
    )
    stop_lines = [line for line in lines if ", stopped after step " in line]
    stop_steps = [int(line.split()[-1]) for line in stop_lines]
    assert stop_steps == stops.steps[stops.steps < TIME_STEPS].tolist()


def test_a_margin_of_ones_own(build, program, capsys):
    stop = as_json(build, capsys, "--stop", "margin", "--margin", 5)["stop"]
    assert (stop["margin"], stop["calibrated_on"]) == (5.0, None)
    assert stop["steps"] == hw.stop_at_margin(program, spikes(build), 5.0).steps.mean()


def test_no_lead_is_enough(build, capsys):
    """Silent recordings have no lead at all: nothing is stopped, and JSON knows no infinity."""
    options = ("--stop", "margin", "--calibrate", build / "silent.npy")
    stop = as_json(build, capsys, *options)["stop"]
    assert (stop["margin"], stop["steps"], stop["agreement"]) == (None, TIME_STEPS, 1.0)
    assert run(build, *options) == 0
    assert (
        "margin: no lead is enough for 99.0 % agreement on 2 recordings of silent.npy"
        in capsys.readouterr().out.splitlines()
    )


def test_the_train_part_calibrates_and_the_test_part_is_played(build, program, capsys, tmp_path):
    train_count = 4
    more = spikes(build, "more")
    for part, recordings in (("train", more[:train_count]), ("test", more[train_count:])):
        (tmp_path / part).mkdir()
        for i, recording in enumerate(recordings):
            # Files of single recordings are (taxels, polarities, steps).
            by_taxel = recording.T.reshape(CHANNELS // 2, 2, RECORDED_STEPS)
            np.save(tmp_path / part / f"sample_{i}_label_{i}.npy", by_taxel)
    options = ("--stop", "margin", "--calibrate", tmp_path, "--min-agreement", 1)
    arguments = [str(word) for word in ("run", build / "out", "--events", tmp_path, *options)]
    assert main([*arguments, "--json"]) == 0
    stop = json.loads(capsys.readouterr().out)["stop"]
    assert stop["recordings"] == MORE - train_count
    assert stop["calibrated_on"]["part"] == "train"
    assert stop["calibrated_on"]["recordings"] == train_count
    assert stop["margin"] == hw.calibrate_margin(program, more[:train_count], 1.0)
    assert main(arguments) == 0
    assert f"on 4 recordings of {tmp_path.name}, train part" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("--stop prove", "--stop prove: it is not known. Did you mean 'proven'?"),
        ("--stop margin", "--stop margin: the margin is not known. Give either --calibrate FILE or --margin X."),
        ("--stop margin --margin 3 --calibrate more.npy", "--stop margin: the margin is given twice. Give either --calibrate FILE or --margin X."),
        ("--margin 3", "--margin: nothing requested has a margin. Add --stop margin."),
        ("--stop proven --calibrate more.npy", "--calibrate: nothing requested has a margin. Add --stop margin."),
        ("--stop margin --margin 3 --min-agreement 0.9", "--min-agreement: no margin is calibrated. Add --calibrate FILE."),
        ("--stop silence", "--stop silence: it goes together with --silence N. Give both or neither."),
        ("--silence 3", "--stop silence: it goes together with --silence N. Give both or neither."),
        ("--stop silence --silence 0", "--silence 0: it is out of range. Give a number from 1 up."),
        ("--stop margin --margin 0", "--margin 0: it is out of range. Give a number above 0."),
        ("--stop margin --margin nan", "--margin nan: it is out of range. Give a number above 0."),
        ("--stop margin --calibrate more.npy --min-agreement 1.5", "--min-agreement 1.5: it is out of range. Give a number from 0 to 1."),
        ("--stop proven --psi 3", "--psi: nothing requested weighs the branches. Add --stream or --stop margin."),
        ("--stream --psi -3", "--psi -3: it is out of range. Give a number from 0 up."),
        ("--step-seconds 0.02", "--step-seconds: nothing requested is timed. Add --stream."),
        ("--stream --step-seconds inf", "--step-seconds inf: it is out of range. Give a number above 0."),
        ("--stop margin --calibrate few.npy", "--calibrate 'few.npy': these recordings are also played, and a margin always suits the recordings that it was found on. Give others."),
        ("--stop margin --calibrate gone.npy", "file 'gone.npy': it does not exist. Check the path."),
    ],
    ids=["kind", "no margin", "two margins", "margin alone", "calibrate alone", "agreement alone", "no length", "silence alone", "no silence", "no lead", "not a number", "no share", "psi alone", "negative psi", "length alone", "endless step", "same recordings", "no file"],
)  # fmt: skip
def test_bad_options_are_one_line(build, capsys, monkeypatch, options, line):
    monkeypatch.chdir(build)
    assert run(build, *options.split()) == 2
    assert capsys.readouterr() == ("", line + "\n")


def test_a_copy_of_what_is_played_calibrates_nothing(build, tmp_path, capsys):
    copy = tmp_path / "copy.npy"
    copy.write_bytes((build / "few.npy").read_bytes())
    assert run(build, "--stop", "margin", "--calibrate", copy) == 2
    line = f"--calibrate {str(copy)!r}: these recordings are also played, and a margin always suits the recordings that it was found on. Give others.\n"  # fmt: skip
    assert capsys.readouterr() == ("", line)


def test_a_recording_that_is_streamed():
    """Two recordings by hand: one whose prediction changes, and a silent one in which all classes tie."""
    changing = Streamed(
        prediction=np.array([0, 4, 4, 2, 4]),
        lead=np.array([0.0, 2.0, 1.0, 0.0, 3.0]),
        seconds=np.array([1.0, 1.0, 1.0, 1.0, 6.0]),
        decided=np.array([-1, 4, 4, 2, 4]),
    )
    silent = Streamed(
        prediction=np.zeros(3, dtype=np.int64),
        lead=np.zeros(3),
        seconds=np.full(3, 2.0),
        decided=np.full(3, -1),
    )
    assert changing.changes == (
        Change(step=2, prediction=4, lead=2.0),
        Change(step=4, prediction=2, lead=0.0),
        Change(step=5, prediction=4, lead=3.0),
    )
    assert changing.filled(7).tolist() == [-1, 4, 4, 2, 4, 4, 4]
    assert silent.changes == ()
    both = [changing, silent]
    assert right_over_time(both, [4, 0], 5).tolist() == [0.0, 0.5, 0.5, 0.0, 0.5]
    # -1: to predict nothing is right.
    assert right_over_time(both, [4, -1], 5).tolist() == [0.5, 1.0, 1.0, 0.5, 1.0]
    latency = step_latency(both)
    assert (latency.mean, latency.worst) == (2.0, 6.0)
    assert latency.p99 == np.quantile([1, 1, 1, 1, 6, 2, 2, 2], 0.99)


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


def test_a_terminal_shows_one_line_over_and_over(monkeypatch):
    monkeypatch.setenv("COLUMNS", "12")
    stream = Terminal()
    line = LiveLine(stream)
    line.show("first")
    line.show("a line that is longer than the terminal")
    line.write("settled")
    line.close()
    assert stream.getvalue() == "\r\x1b[Kfirst\r\x1b[Ka line that\r\x1b[Ksettled\n\r\x1b[K"


@pytest.mark.slow
def test_streaming_to_a_terminal_shows_leads_as_they_grow(build, program, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stdout", stream)
    assert run(build, "--stream") == 0
    # Lines end in a line break, or in the code that clears a terminal's line.
    lines = re.split(r"\r\x1b\[K|\n", stream.getvalue())
    lead_lines = [line for line in lines if "  lead " in line]
    expected_count = 0
    for scores in hw.timestep_scores(program, spikes(build)):
        last_shown = None
        for row in scores:
            best, second = sorted(row.tolist(), reverse=True)[:2]
            prediction_and_lead = (int(row.argmax()), best - second)
            is_first = last_shown is None and best > second
            is_new = last_shown is not None and prediction_and_lead != last_shown
            if is_first or is_new:
                expected_count += 1
                last_shown = prediction_and_lead
    assert len(lead_lines) == expected_count


@pytest.mark.parametrize(
    ("lead", "shown"),
    [(0.0, "0"), (3.45e-07, "under 0.01"), (0.01, "0.01"), (2.5, "2.5"), (12345.0, "12,345")],
)
def test_a_lead_is_shown_as_people_read_it(lead, shown):
    assert lead_text(lead) == shown
