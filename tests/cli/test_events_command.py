"""``locsnn events``: figures, rasters and conversions, end to end.

All figures of a small set of four events are worked out by hand.
"""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from locsnn_compile.cli.main import main
from locsnn_compile.data import Recordings, read_recordings, write_recordings
from locsnn_compile.report.pictures.recording import text_raster

ROOT = Path(__file__).parents[2]


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Three recordings of 8 steps and 78 channels with four events, the last recording silent."""
    spikes = np.zeros((3, 8, 78), dtype=np.uint8)
    spikes[0, 2, [0, 1]] = 1
    spikes[0, 5, 0] = 1
    spikes[1, 7, 2] = 1
    write_recordings(
        tmp_path / "small.npz",
        Recordings(spikes, np.array([1, 0, 1]), step_seconds=0.02, source="small"),
    )
    return tmp_path / "small.npz"


TEXT = (
    f"""\
small.npz: 3 recordings, 8 steps of 0.02 s (0.16 s), 78 channels
labels            2 classes (0: 1, 1: 2)
events            1.3 per recording (0 to 3), 0.21 % of bins
rate              0.107 Hz per channel, 8.333 Hz in all
silent at start   4.5 steps (2 to 7)
silent at end     1.0 steps (0 to 2)
silent steps      87.5 %, 1 recording without any event
polarity          75.0 % rising, 25.0 % falling
busiest channels  0 (taxel 1 rising) 2, 1 (taxel 1 falling) 1, 2 (taxel 2 rising) 1
dead channels     {", ".join(map(str, range(3, 27)))}, and 51 more
recording 0, label 1:
|  █  ▒  |
"""
    + "|        |\n" * 19
)


def test_figures(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["events", str(small)]) == 0
    assert capsys.readouterr().out == TEXT


def test_figures_as_json(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["events", str(small), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document.pop("dead_channels") == list(range(3, 78))
    assert document == {
        "schema": "locsnn-events/1",
        "source": "small.npz",
        "recordings": 3,
        "steps": 8,
        "channels": 78,
        "step_seconds": 0.02,
        "labels": {"0": 1, "1": 2},
        "events": {
            "all": 4,
            "per_recording": {"mean": 4 / 3, "least": 0, "most": 3},
            "share_of_bins": 4 / 1872,
        },
        "rate_hz_per_channel": 4 / (3 * 78 * 0.16),
        "silence": {
            "empty_recordings": 1,
            "start_steps": {"mean": 4.5, "least": 2, "most": 7},
            "end_steps": {"mean": 1.0, "least": 0, "most": 2},
            "share_of_steps": 0.875,
        },
        "polarity": {"rising": 0.75, "falling": 0.25},
        "busiest_channels": [
            {"channel": 0, "place": "taxel 1 rising", "events": 2},
            {"channel": 1, "place": "taxel 1 falling", "events": 1},
            {"channel": 2, "place": "taxel 2 rising", "events": 1},
        ],
        "assumptions": [],
    }


def test_a_set_of_one_event_without_sensor_or_width(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "a.npy", np.array([[0, 1], [0, 0]], dtype=np.uint8))
    assert main(["events", str(tmp_path / "a.npy")]) == 0
    assert capsys.readouterr().out == (
        "a.npy: 1 recording, 2 steps, 2 channels\nlabels            none\n"
        "events            1.0 per recording (1 to 1), 25.00 % of bins\n"
        "silent at start   1.0 steps (1 to 1)\nsilent at end     0.0 steps (0 to 0)\n"
        "silent steps      50.0 %, 0 recordings without any event\n"
        "busiest channels  0 1\ndead channels     1\nrecording 0:\n| █|\n|  |\n"
    )


def test_silence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 3), dtype=np.uint8))
    assert main(["events", str(tmp_path / "a.npy"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["events"]["all"], document["silence"]["empty_recordings"]) == (0, 1)


def test_the_picture(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["events", str(small), "--recording", "1", "-o", str(tmp_path / "r.svg")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"wrote {tmp_path / 'r.svg'}"
    svg = ElementTree.parse(tmp_path / "r.svg").getroot()
    path = svg.find("{http://www.w3.org/2000/svg}path")
    assert path is not None
    # Step 7 of 8 over 720 pixels from 56, channel 2 of 78 over 320 from 40.
    assert path.get("d") == "M686.00 48.21h90.00v4.10h-90.00z"
    words = [text.text for text in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert words == ["small.npz, recording 1", "0", "0.16 s", "0", "77", "time; channels downwards"]


def test_large_rasters_are_drawn_coarser() -> None:
    spikes = np.zeros((1000, 100), dtype=np.uint8)
    spikes[999, 99] = spikes[0, [0, 1]] = 1
    lines = text_raster(spikes)
    assert (len(lines), {len(line) for line in lines}) == (20, {63})
    assert (lines[0].strip(), lines[-1].strip()) == ("█", "▒")


NAMELESS = "names of classes are left out: only .npz and .pt files hold them"


def test_conversion(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["events", str(small), "--to", str(tmp_path / "out"), "--members", "bs1"]) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [
        f"wrote {tmp_path / 'out'}",
        "read it with --channels 78 --polarities 2: the format does not say so",
    ]
    assert (
        main(
            [
                "events",
                str(tmp_path / "out"),
                "--channels",
                "78",
                "--polarities",
                "2",
                "--to",
                str(tmp_path / "back.npz"),
            ]
        )
        == 0
    )
    assert (tmp_path / "back.npz").read_bytes() == small.read_bytes()
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "sample_0_label_1.bs1",
        "sample_1_label_0.bs1",
        "sample_2_label_1.bs1",
    ]


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        (
            ["--to", "out.zip"],
            ["it holds the test part alone: --part train gives the other", NAMELESS],
        ),
        (["--to", "out.zip", "--part", "test"], [NAMELESS]),
        (["--to", "out.npz"], ["it holds the test part alone: --part train gives the other"]),
        (["--to", "out.npz", "--part", "train"], []),
    ],
)
def test_what_a_conversion_leaves_out(
    tmp_path: Path,
    options: list[str],
    lines: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for place in ("train/press", "train/slide", "test/press", "test/slide"):
        Path("set", place).mkdir(parents=True)
        np.save(Path("set", place, "sample_0.npy"), np.eye(4, dtype=np.uint8))
    assert main(["events", "set", *options]) == 0
    assert capsys.readouterr().out.splitlines()[-1 - len(lines) :] == [
        f"wrote {options[1]}",
        *lines,
    ]


def test_a_conversion_of_what_is_divided_on_reading_says_its_part(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motions = str(ROOT / "examples/recordings/motions.npz")
    assert main(["events", motions, "--split", "0.25", "--to", str(tmp_path / "part.npz")]) == 0
    assert (
        capsys.readouterr().out.splitlines()[-1]
        == "it holds the test part alone: --part train gives the other"
    )


def test_the_example_of_the_help(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    touches = "examples/recordings/touches.npz"
    assert main(["events", touches, "--to", str(tmp_path / "touches.zip"), "--members", "bs1"]) == 0
    assert np.array_equal(
        read_recordings(tmp_path / "touches.zip").spikes, read_recordings(touches).spikes
    )


# Each row: its id, options of `locsnn events small.npz`, and the line on standard error.
REFUSED = [
    ("no such recording", ["--recording", "3"], "--recording 3: there is no such recording (3 in small.npz). Count from 0 to 2."),
    ("another picture", ["-o", "r.png"], "-o 'r.png': rasters are written as .svg. End the name in .svg."),
    ("members of nothing", ["--members", "bs1"], "--members: no folder or .zip is written. Add --to with a folder or .zip."),
    ("structured nothing", ["--structured", "--to", "a.pt"], "--structured: no .npy or .npz is written. Add --to with such a file."),
    ("a part of a file", ["--part", "train"], "file 'small.npz': there is no part 'train' (a single file is not divided). Leave the part out."),
    ("a width of none", ["--step-seconds", "0"], "--step-seconds 0: it is out of range. Give a number above 0."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED]
)
def test_options_that_nothing_comes_of(
    small: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["events", str(small), *options]) == 2
    assert capsys.readouterr().err == f"{message.replace(repr(small.name), repr(str(small)))}\n"
    assert [file.name for file in small.parent.iterdir()] == ["small.npz"]


@pytest.mark.parametrize("members", ["npy", "events", "bs1", "bs2"])
def test_files_of_a_grid_are_read_as_that_grid(tmp_path, monkeypatch, capsys, members):
    monkeypatch.chdir(tmp_path)
    spikes = np.ones((2, 3, 40), dtype=np.uint8)
    write_recordings(
        "grid.npz", Recordings(spikes, np.array([1, 0]), step_seconds=0.02, source="grid")
    )
    assert (
        main(["events", "grid.npz", "--grid", "4x5", "--to", "grid.zip", "--members", members]) == 0
    )
    assert (
        main(["events", "grid.zip", "--grid", "4x5", "--step-seconds", "0.02", "--to", "again.npz"])
        == 0
    )
    assert capsys.readouterr().err == ""
    assert np.array_equal(read_recordings("again.npz").spikes, spikes)
