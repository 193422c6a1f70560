"""``locsnn run`` step by step and stopped early."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.io.yaml_text import SEAL
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


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A build; three recordings of 60 steps with labels, and six to calibrate on."""
    folder = tmp_path_factory.mktemp("build")
    r = np.random.default_rng(0)
    for name, samples in (("few", 3), ("more", 6)):
        np.save(folder / f"{name}.npy", (r.random((samples, 78, 60)) < 0.1).astype(np.uint8))
        np.save(folder / f"{name}_labels.npy", np.arange(samples))
    np.save(folder / "silent.npy", np.zeros((2, 78, 60), dtype=np.uint8))
    options = "--quiet --strategy dendrite --psi 3".split()
    arguments = [MODEL, "--events", folder / "few.npy", "-o", folder / "out", *options]
    assert compile_main([str(a) for a in arguments]) == 0
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
    """The steps at which the prediction is another one, from the first lead on, by plain Python."""
    found, last = [], None
    for step, row in enumerate(scores, start=1):
        first, second = sorted(row.tolist(), reverse=True)[:2]
        if last is None and first == second:
            continue
        if row.argmax() != last:
            last = int(row.argmax())
            found.append({"step": step, "prediction": last, "lead": first - second})
    return found


@pytest.mark.slow
@pytest.mark.parametrize("psi", [None, 10.0], ids=["plain", "time-weighted"])
def test_json_has_every_change_of_the_prediction(build, program, capsys, psi):
    found = as_json(build, capsys, "--stream", *(() if psi is None else ("--psi", psi)))
    scores = hw.timestep_scores(program, spikes(build), psi)
    assert scores.shape == (3, 250, 36)
    for row, one in zip(found["recordings"], scores, strict=True):
        assert row["changes"] == changes(one)
        assert row["changes"][-1]["prediction"] == row["prediction"]
    stream = found["stream"]
    assert (stream["psi"], stream["step_seconds"], stream["right_is"]) == (
        psi,
        pytest.approx(0.02),
        "the label",
    )
    wanted = (scores.argmax(axis=2) == np.arange(3)[:, None]).mean(axis=0)
    assert stream["right"] == wanted.tolist()
    latency = stream["step_latency_seconds"]
    assert 0 < latency["mean"] <= latency["worst"]
    assert latency["p99"] <= latency["worst"]
    assert stream["real_time_factor"] == pytest.approx(0.02 / latency["mean"])
    assert stream["worst_real_time_factor"] == pytest.approx(0.02 / latency["worst"])


@pytest.mark.slow
def test_lines_change_only_with_the_prediction(build, program, capsys):
    assert run(build, "--stream") == 0
    lines = iter(capsys.readouterr().out.splitlines())
    for recording, scores in enumerate(hw.timestep_scores(program, spikes(build))):
        last = changes(scores)
        for change in last:
            seconds = f"{change['step'] * 0.02:.2f} s"
            assert next(lines) == (
                f"recording {recording}  step {change['step']} of 250  {seconds}  "
                f"class {change['prediction']}  lead {change['lead']:.3g}"
            )
        assert next(lines) == (
            f"recording {recording}: class {last[-1]['prediction']}  label {recording}  since step {last[-1]['step']}"
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
def test_the_length_of_a_step_is_told_or_left_out(build, capsys, tmp_path):
    assert run(build, "--stream", "--step-seconds", 0.5) == 2
    refused = (
        "step_seconds: program 'objects-hybrid' has another (got 0.5 against 0.02). Leave it out.\n"
    )
    assert capsys.readouterr() == ("", refused)
    text = (build / "out/program.yaml").read_text().replace("step_seconds: 0.02\n", "")
    (tmp_path / "program.yaml").write_text(text.rpartition(SEAL)[0])
    (tmp_path / "program.npz").write_bytes((build / "out/program.npz").read_bytes())
    silent = ["run", str(tmp_path), "--events", str(build / "silent.npy"), "--stream"]
    assert main([*silent, "--step-seconds", "0.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stream"]["step_seconds"] == 0.5
    assert main(silent) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "recording 0: all classes tie"
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
    scores = hw.timestep_scores(program, spikes(build), 3.0)
    shares = (scores.argmax(axis=2) == np.arange(3)[:, None]).mean(axis=0)
    assert (entry["psi"], entry["steps"]) == (3.0, list(range(5, 251, 5)))
    assert entry["right"]["time_weighted"] == shares[4::5].tolist()
    assert compile_main([str(MODEL), "--psi", "inf"]) == 2
    assert capsys.readouterr().err == "--psi inf: it is out of range. Give a number from 0 up.\n"


def test_proven_stops(build, program, capsys):
    found = as_json(build, capsys, "--stop", "proven")
    stops = hw.stop_when_proven(program, spikes(build))
    stop = found["stop"]
    assert (stop["kind"], stop["agreement"], stop["all_steps"], stop["recordings"]) == (
        "proven",
        1.0,
        328,
        3,
    )
    assert [row["stop"]["step"] for row in found["recordings"]] == stops.steps.tolist()
    assert [row["stop"]["prediction"] for row in found["recordings"]] == [
        row["prediction"] for row in found["recordings"]
    ]
    assert stop["all_synaptic_ops"] == found["counts"]["synaptic_ops"] / 3
    assert stop["all_energy_pj"] == pytest.approx(sum(found["energy_pj"].values()) / 3)
    assert stop["synaptic_ops"] == stops.counts.synaptic_ops / 3
    assert stop["profile"] == "davies2018"
    assert run(build, "--stop", "proven") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == [
        "recording 0",
        "recording 1",
        "recording 2",
    ]
    assert re.fullmatch(
        r"stopped \(proven\) after \d+ of 328 steps on average; saved [\d.]+ % of the steps, "
        r"[\d.]+ % of the synaptic operations, [\d.]+ % of the energy; "
        r"[\d.]+ µJ instead of [\d.]+ µJ, and [\d.]+ [µm]s instead of [\d.]+ [µm]s \(profile davies2018\)",
        lines[-2],
    )
    accuracy = stop["whole_accuracy"]
    assert lines[-1] == (
        f"same prediction as the whole recording in 100 % of 3 recordings; accuracy {accuracy:.3f} instead of {accuracy:.3f}"
    )


def test_stops_in_silence(build, program, capsys):
    given = spikes(build)
    given = np.concatenate((given, np.zeros((3, 190, 78), dtype=np.uint8)), axis=1)
    stops = hw.stop_in_silence(program, given, 9)
    stop = as_json(build, capsys, "--stop", "silence", "--silence", 9)["stop"]
    assert (stop["kind"], stop["steps"], stop["all_steps"]) == ("silence", stops.steps.mean(), 250)
    assert 69 < stop["steps"] < 250
    assert (stop["latency_ns"], stop["all_latency_ns"]) == (
        pytest.approx(stops.latency_ns / 3), pytest.approx(stops.all_latency_ns / 3),
    )  # fmt: skip
    report = json.loads((build / "out/report.json").read_text())
    assert stop["all_latency_ns"] == pytest.approx(report["latency"]["per_sample_ns"])
    assert stop["latency_ns"] < stop["all_latency_ns"]
    assert stop["energy_pj"] < stop["all_energy_pj"]
    assert stop["agreement"] == 1.0
    assert run(build, "--stop", "silence", "--silence", 9) == 0
    assert capsys.readouterr().out.splitlines()[-2].startswith("stopped (silence) after ")


@pytest.mark.slow
@pytest.mark.parametrize("psi", [None, 10.0], ids=["plain", "time-weighted"])
def test_a_calibrated_margin(build, program, capsys, psi):
    weighted = () if psi is None else ("--psi", psi)
    options = (
        "--stop",
        "margin",
        "--calibrate",
        build / "more.npy",
        "--min-agreement",
        0.5,
        *weighted,
    )
    found = as_json(build, capsys, "--stream", *options)
    margin = hw.calibrate_margin(program, spikes(build, "more"), 0.5, psi)
    stops = hw.stop_at_margin(program, spikes(build), margin, psi)
    stop = found["stop"]
    assert (stop["kind"], stop["margin"], stop["all_steps"]) == ("margin", margin, 250)
    assert stop["steps"] == stops.steps.mean() < 250
    assert stop["agreement"] == (stops.prediction == stops.final).mean()
    assert stop["accuracy"] == (stops.prediction == np.arange(3)).mean()
    calibrated = stop["calibrated_on"]
    assert calibrated["agreement"] >= 0.5
    assert {**calibrated, "agreement": 1} == {
        "source": "more.npy",
        "part": None,
        "recordings": 6,
        "min_agreement": 0.5,
        "agreement": 1,
    }
    scores = hw.timestep_scores(program, spikes(build), psi)
    for row, step, one in zip(found["recordings"], stops.steps, scores, strict=True):
        assert row["stop"] == {"step": step, "prediction": int(one[step - 1].argmax())}
        assert row["changes"] == changes(one[:step])
    assert run(build, "--stream", *options) == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        f"margin: a lead of {margin:.4g} is enough for 50.0 % agreement on 6 recordings of more.npy"
        in lines
    )
    ends = [line for line in lines if ", stopped after step " in line]
    assert [int(line.split()[-1]) for line in ends] == stops.steps[stops.steps < 250].tolist()


def test_a_margin_of_ones_own(build, program, capsys):
    stop = as_json(build, capsys, "--stop", "margin", "--margin", 5)["stop"]
    assert (stop["margin"], stop["calibrated_on"]) == (5.0, None)
    assert stop["steps"] == hw.stop_at_margin(program, spikes(build), 5.0).steps.mean()


def test_no_lead_is_enough(build, capsys):
    """Silent recordings have no lead at all: nothing is stopped, and JSON knows no infinity."""
    options = ("--stop", "margin", "--calibrate", build / "silent.npy")
    stop = as_json(build, capsys, *options)["stop"]
    assert (stop["margin"], stop["steps"], stop["agreement"]) == (None, 250.0, 1.0)
    assert run(build, *options) == 0
    assert (
        "margin: no lead is enough for 99.0 % agreement on 2 recordings of silent.npy"
        in capsys.readouterr().out.splitlines()
    )


def test_the_train_part_calibrates_and_the_test_part_is_played(build, program, capsys, tmp_path):
    for part, first in (("train", 0), ("test", 4)):
        (tmp_path / part).mkdir()
        for i, recording in enumerate(spikes(build, "more")[first : first + 4]):
            np.save(tmp_path / part / f"sample_{i}_label_{i}.npy", recording.T.reshape(39, 2, 60))
    options = ("--stop", "margin", "--calibrate", tmp_path, "--min-agreement", 1)
    arguments = ["run", build / "out", "--events", tmp_path, *options, "--json"]
    assert main([str(a) for a in arguments]) == 0
    stop = json.loads(capsys.readouterr().out)["stop"]
    assert (
        stop["recordings"],
        stop["calibrated_on"]["part"],
        stop["calibrated_on"]["recordings"],
    ) == (2, "train", 4)
    assert stop["margin"] == hw.calibrate_margin(program, spikes(build, "more")[:4], 1.0)
    assert main([str(a) for a in arguments[:-1]]) == 0
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
    leads, seen = [0.0, 2.0, 1.0, 0.0, 3.0], [0, 4, 4, 2, 4]
    decided = np.array([-1, 4, 4, 2, 4])
    found = Streamed(np.array(seen), np.array(leads), np.array([1.0, 1.0, 1.0, 1.0, 6.0]), decided)
    assert found.changes == (Change(2, 4, 2.0), Change(4, 2, 0.0), Change(5, 4, 3.0))
    assert found.filled(7).tolist() == [-1, 4, 4, 2, 4, 4, 4]
    silent = Streamed(np.zeros(3, dtype=np.int64), np.zeros(3), np.full(3, 2.0), np.full(3, -1))
    assert silent.changes == ()
    assert right_over_time([found, silent], [4, 0], 5).tolist() == [0.0, 0.5, 0.5, 0.0, 0.5]
    assert right_over_time([found, silent], [4, -1], 5).tolist() == [0.5, 1.0, 1.0, 0.5, 1.0]
    latency = step_latency([found, silent])
    assert (latency.mean, latency.worst) == (2.0, 6.0)
    assert latency.p99 == np.quantile([1, 1, 1, 1, 6, 2, 2, 2], 0.99)


class Terminal(io.StringIO):
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
    shown = [part for part in re.split(r"\r\x1b\[K|\n", stream.getvalue()) if "  lead " in part]
    wanted = 0
    for scores in hw.timestep_scores(program, spikes(build)):
        last = None
        for row in scores:
            first, second = sorted(row.tolist(), reverse=True)[:2]
            now = (int(row.argmax()), first - second)
            if now != last and (last is not None or first > second):
                wanted, last = wanted + 1, now
    assert len(shown) == wanted


@pytest.mark.parametrize(
    ("lead", "shown"),
    [(0.0, "0"), (3.45e-07, "under 0.01"), (0.01, "0.01"), (2.5, "2.5"), (12345.0, "12,345")],
)
def test_a_lead_is_shown_as_people_read_it(lead, shown):
    assert lead_text(lead) == shown
