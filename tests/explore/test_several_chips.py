"""``locsnn explore`` with several chips: figures of each chip, and why others refuse the network.

Figures and refusals are compared with builds of ``locsnn-compile`` for the same chip.
"""

import csv
import json
import shlex

import numpy as np
import pytest

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.errors import InputError
from locsnn_compile.explore import chip_points
from locsnn_compile.explore.chip_points import ChipFigures
from locsnn_compile.explore.chips import ChipsDocument, TriedChip
from locsnn_compile.explore.chips_result import chips_files, chips_lines
from locsnn_compile.explore.document import ExploredEvents, ExploredModel
from tests.support.explored_model import explore, explored, files_without_timings

CHIPS = ("loihi-sim", "ecp5-85f", "spinnaker1", "xylo-audio3")
RESET = ("--strategy", "reset")


def on(*chips):
    """The options that name these chips."""
    return [text for chip in chips for text in ("--target", chip)]


@pytest.fixture(scope="module")
def tried(model, events, tmp_path_factory):
    """The folder of an exploration of strategy reset on all these chips."""
    folder = tmp_path_factory.mktemp("chips") / "out"
    assert explore(model, "--events", events, *RESET, *on(*CHIPS), "-o", folder, "--quiet") == 0
    return folder


def row_of(folder, chip):
    """Return the row of a chip in explore.json."""
    (row,) = (row for row in explored(folder)["chips"] if row["target"] == chip)
    return row


@pytest.mark.slow
@pytest.mark.parametrize("chip", CHIPS[:3])
def test_figures_of_a_chip_are_those_of_its_build(tried, tmp_path, chip):
    row = row_of(tried, chip)
    program, *arguments = shlex.split(row["command"])
    assert program == "locsnn-compile"
    assert compile_main([*arguments, "-o", str(tmp_path / "build"), "--quiet"]) == 0
    report = json.loads((tmp_path / "build" / "report.json").read_text())
    figures = row["figures"]
    assert figures["strategy"] == report["strategy"] == "reset"
    assert figures["spike_error"] == 1 - report["match"]["spike_agreement"]
    assert figures["prediction_error"] == 1 - report["match"]["prediction_agreement"]
    assert figures["score_error"] == report["match"]["score_error"]
    assert figures["accuracy"] == report["accuracy"]["chip"]
    assert figures["cores"] == report["resources"]["cores"]
    assert figures["synaptic_ops"] == report["operations"]["per_sample"]["synaptic_ops"]
    assert figures["chip_time_ns"] == report["latency"]["per_sample_ns"]
    assert figures["energy_pj"] == report["energy"]["per_sample_pj"]
    assert figures["energy_profile"] == report["energy"]["profile"]


def test_a_chip_that_refuses_stands_in_the_table_with_the_sentence_of_its_build(
    tried, tmp_path, capsys
):
    row = row_of(tried, "xylo-audio3")
    assert row["figures"] is None
    arguments = shlex.split(row["command"])[1:]
    assert compile_main([*arguments, "-o", str(tmp_path / "build")]) == 1
    assert capsys.readouterr().err == f"{row['refused']}\n"
    assert explored(tried)["runs_on"] == list(CHIPS[:3])


def test_the_same_command_writes_the_same_bytes(tried, model, events, tmp_path, capsys):
    again = tmp_path / "again"
    arguments = (model, "--events", events, *RESET, *on(*CHIPS), "-o", again)
    assert explore(*arguments, "--json") == 0
    assert capsys.readouterr().out == (tried / "explore.json").read_text()
    for name in ("explore.json", "explore.csv", "explore.svg"):
        assert (again / name).read_bytes() == (tried / name).read_bytes()


GRID = ("--strategy", "dendrite", "reset", "--weight-bits", 4, 8)
DENDRITE_ON_SPINNAKER = (
    "strategy: it joins compartments, and a neuron of spinnaker1 is a single one (got dendrite). "
    "Use strategy reset."
)
WIDTH_ON_SPINNAKER = (
    "weight_bits: weights for spinnaker1 are rounded to one width (got 4). Leave it out."
)


@pytest.fixture(scope="module")
def grid(model, events, tmp_path_factory):
    """The folder of an exploration of two strategies and two widths on two chips."""
    folder = tmp_path_factory.mktemp("grid") / "out"
    arguments = (*GRID, *on("loihi-sim", "spinnaker1"), "-o", folder, "--quiet")
    assert explore(model, "--events", events, *arguments) == 0
    return folder


def test_every_chip_is_tried_with_every_combination_of_the_values(grid):
    """A chip that lacks a value says which dial it lacks, in the row of that value alone."""
    rows = {row["name"]: row for row in explored(grid)["chips"]}
    assert {name: row["refused"] for name, row in rows.items()} == {
        "loihi-sim (dendrite, 4-bit)": None,
        "loihi-sim (dendrite, 8-bit)": None,
        "loihi-sim (reset, 4-bit)": None,
        "loihi-sim (reset, 8-bit)": None,
        "spinnaker1 (dendrite, 4-bit)": DENDRITE_ON_SPINNAKER,
        "spinnaker1 (dendrite, 8-bit)": DENDRITE_ON_SPINNAKER,
        "spinnaker1 (reset, 4-bit)": WIDTH_ON_SPINNAKER,
        "spinnaker1 (reset, 8-bit)": None,
    }
    assert rows["loihi-sim (reset, 4-bit)"]["setting"] == {"strategy": "reset", "weight_bits": 4}
    assert rows["spinnaker1 (reset, 8-bit)"]["figures"]["strategy"] == "reset"


def test_rows_of_one_chip_have_the_figures_of_its_own_exploration(grid, model, events, tmp_path):
    arguments = (*GRID, "--split-weights", "none", "--engines", "-o", tmp_path / "one", "--quiet")
    assert explore(model, "--events", events, *arguments) == 0
    rows = explored(grid)["chips"][:4]
    for point, row in zip(explored(tmp_path / "one")["points"], rows, strict=True):
        shared = set(point["figures"]) & set(row["figures"])
        assert len(shared) == 10  # so that the loop below compares something
        for name in shared:
            assert point["figures"][name] == row["figures"][name], name


@pytest.mark.slow
def test_processes_measure_the_same_bytes(grid, model, events, tmp_path):
    arguments = (*GRID, *on("loihi-sim", "spinnaker1"), "--workers", 2, "--quiet")
    assert explore(model, "--events", events, *arguments, "-o", tmp_path / "out") == 0
    assert files_without_timings(tmp_path / "out") == files_without_timings(grid)


def test_an_interrupted_run_goes_on_with_what_is_missing(
    grid, model, events, tmp_path, monkeypatch, capsys
):
    arguments = (model, "--events", events, *GRID, *on("loihi-sim", "spinnaker1"), "--quiet")
    measure_chip = chip_points.measure_chip
    measured = []

    def stopped(study, setting):
        if len(measured) == 3:
            raise KeyboardInterrupt
        measured.append(setting.name(("strategy", "weight_bits")))
        return measure_chip(study, setting)

    monkeypatch.setattr(chip_points, "measure_chip", stopped)
    assert explore(*arguments, "-o", tmp_path / "out") == 130
    assert capsys.readouterr() == ("", "Stopped. The same command resumes from here.\n")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["points"]

    def counted(study, setting):
        measured.append(setting.name(("strategy", "weight_bits")))
        return measure_chip(study, setting)

    monkeypatch.setattr(chip_points, "measure_chip", counted)
    assert explore(*arguments, "-o", tmp_path / "out") == 0
    assert measured == [row["name"] for row in explored(grid)["chips"]]
    assert files_without_timings(tmp_path / "out") == files_without_timings(grid)


def test_one_chip_of_one_setting_can_be_explored_alone(tried, model, events, tmp_path, capsys):
    arguments = (model, "--events", events, "--target", "spinnaker1", "-o", tmp_path / "out")
    assert explore(*arguments) == 0
    (row,) = explored(tmp_path / "out")["chips"]
    assert row["figures"] == row_of(tried, "spinnaker1")["figures"]
    printed = capsys.readouterr().out
    assert printed.startswith("small on 1 chip, 5 recordings of few.npz\n")
    assert "\nspinnaker1 can run small. spinnaker1 loses least.\n" in printed


def test_one_chip_that_refuses_the_network_says_so_as_its_build_does(model, tmp_path, capsys):
    assert explore(model, "--target", "xylo-imu", "-o", tmp_path / "out", "--quiet") == 1
    error = capsys.readouterr().err
    assert compile_main([str(model), "--target", "xylo-imu", "-o", str(tmp_path / "build")]) == 1
    assert capsys.readouterr().err == error


def test_an_input_that_one_chip_cannot_use_leaves_the_others(model, events, tmp_path, monkeypatch):
    fulfil = chip_points.fulfil

    def refused_by_spinnaker(request):
        if request.chip.name == "spinnaker1":
            raise InputError("events 'few.npz'", "too long for its memory", fix="Cut them.")
        return fulfil(request)

    monkeypatch.setattr(chip_points, "fulfil", refused_by_spinnaker)
    arguments = (*RESET, *on("spinnaker1", "loihi-sim"), "-o", tmp_path / "out", "--quiet")
    assert explore(model, "--events", events, *arguments) == 0
    refused, measured = explored(tmp_path / "out")["chips"]
    assert refused["refused"] == "events 'few.npz': too long for its memory. Cut them."
    assert measured["refused"] is None


def test_recordings_that_fit_no_chip_are_refused_once(model, tmp_path, capsys):
    wide = tmp_path / "wide.npz"
    np.savez(wide, spikes=np.zeros((2, 80, 40), dtype=np.uint8))
    folder = tmp_path / "out"
    assert explore(model, "--events", wide, *on(*CHIPS), "-o", folder, "--quiet") == 2
    error = capsys.readouterr().err
    assert compile_main([str(model), "--events", str(wide), "-o", str(tmp_path / "build")]) == 2
    assert capsys.readouterr().err == error
    assert not folder.exists()


@pytest.mark.parametrize(
    ("bound", "keeping", "code", "line"),
    [
        (1, ["loihi-sim", "spinnaker1"], 0, ""),
        (0, [], 3, "gate failed: no chip keeps --max-spike-error 0.\n"),
    ],
    ids=["any error", "none"],
)
def test_chips_that_keep_a_bound_are_named(
    model, events, tmp_path, capsys, bound, keeping, code, line
):
    arguments = (*RESET, *on("loihi-sim", "spinnaker1"), "--max-spike-error", bound)
    assert explore(model, "--events", events, *arguments, "-o", tmp_path / "out") == code
    document = explored(tmp_path / "out")
    assert [row["name"] for row in document["chips"] if row["keeps_bounds"]] == keeping
    assert document["bounds"]["max_spike_error"] == bound
    printed = capsys.readouterr()
    sentence = (
        f"loihi-sim and spinnaker1 keep --max-spike-error {bound}."
        if keeping
        else (f"None keeps --max-spike-error {bound}.")
    )
    assert sentence in printed.out.splitlines()
    assert printed.err == line


def test_chips_that_run_are_also_reported_on_other_recordings(model, divided, tmp_path, capsys):
    arguments = (*RESET, *on("spinnaker1", "xylo-imu"), "-o", tmp_path / "out")
    assert explore(model, "--events", divided, "--report-on", divided, *arguments) == 0
    document = explored(tmp_path / "out")
    assert (document["compared_on"]["part"], document["compared_on"]["recordings"]) == ("train", 6)
    assert (document["reported_on"]["part"], document["reported_on"]["recordings"]) == ("test", 4)
    measured, refused = document["chips"]
    assert (refused["reported"], refused["report_command"]) == (None, None)
    assert "On 4 recordings of touches, test part:" in capsys.readouterr().out.splitlines()
    arguments = shlex.split(measured["report_command"])[1:]
    assert compile_main([*arguments, "-o", str(tmp_path / "build"), "--quiet"]) == 0
    report = json.loads((tmp_path / "build" / "report.json").read_text())
    assert measured["reported"]["spike_error"] == 1 - report["match"]["spike_agreement"]
    assert measured["reported"]["accuracy"] == report["accuracy"]["chip"]


def test_engines_of_all_chips_are_timed(model, events, tmp_path, capsys):
    arguments = (*RESET, *on("loihi-sim", "spinnaker1"), "--engines", "fast", "reference")
    assert explore(model, "--events", events, *arguments, "-o", tmp_path / "out") == 0
    with (tmp_path / "out" / "timings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["target"], row["engine"], row["recordings"]) for row in rows] == [
        ("loihi-sim", "fast", "5"),
        ("loihi-sim", "reference", "1"),
        ("spinnaker1", "fast", "5"),
        ("spinnaker1", "reference", "1"),
    ]
    assert all(float(row["seconds_per_recording"]) > 0 for row in rows)
    sentence = "fast and reference: time per recording in the simulator's engines, here."
    assert sentence in capsys.readouterr().out.splitlines()


def test_no_chip_that_can_run_it_is_an_error_with_every_sentence(model, tmp_path, capsys):
    folder = tmp_path / "out"
    chips = ("xylo-audio2", "xylo-imu")
    assert explore(model, *on(*chips), "-o", folder, "--quiet") == 1
    error = capsys.readouterr().err
    assert error.startswith("--target: no chip can run it (xylo-audio2: ")
    assert "; xylo-imu: " in error
    assert error.endswith(". Try other chips of locsnn targets.\n")
    assert not (folder / "explore.json").exists()


def figures(spike_error, time_ns=None, energy_pj=None):
    """Return figures of a chip, of which some are given."""
    return ChipFigures(
        strategy="reset",
        weight_bits=8,
        spike_error=spike_error,
        prediction_error=0.0,
        score_error=None,
        accuracy=0.75,
        float_accuracy=1.0,
        cores=2,
        synapses=100,
        synaptic_ops=1234.0,
        chip_time_ns=time_ns,
        energy_pj=energy_pj,
        energy_profile=None if energy_pj is None else "davies2018",
    )


def tried_chip(target, command, chip_figures=None, refused=None):
    """Return a row of explore.json that has either figures or a refusal."""
    return TriedChip(
        target=target,
        name=target,
        setting={},
        figures=chip_figures,
        refused=refused,
        keeps_bounds=None,
        reported=None,
        command=command,
        report_command=None,
    )


DOCUMENT = ChipsDocument(
    schema="locsnn-explore-chips/1",
    code="1",
    model=ExploredModel("small", sha256=None),
    compared_on=ExploredEvents("few.npz", part=None, recordings=5, available=5),
    reported_on=None,
    bounds=None,
    runs_on=("loihi-sim", "spinnaker1"),
    lose_least=("spinnaker1",),
    chips=(
        tried_chip(
            "loihi-sim", "locsnn-compile a", figures(spike_error=0.02, time_ns=1e6, energy_pj=2e6)
        ),
        tried_chip("spinnaker1", "locsnn-compile b", figures(0.01, 3.5e8)),
        tried_chip("xylo-imu", "locsnn-compile c", refused="a population steps over locations."),
    ),
)


def test_the_terminal_shows_a_table_the_refusals_and_an_answer():
    assert "\n".join(chips_lines(DOCUMENT, "5 recordings of few.npz")) == GOLDEN


GOLDEN = """\
small on 3 chips, 5 recordings of few.npz

   chip        strategy  weight bits  spike error  class error  score error  accuracy  cores  synaptic operations  chip time     energy
   loihi-sim   reset               8        2.0 %          0 %      all tie    75.0 %      2                1,234    1.00 ms    2.00 µJ
>  spinnaker1  reset               8        1.0 %          0 %      all tie    75.0 %      2                1,234     350 ms  not known
xylo-imu refuses it: a population steps over locations.
> least is lost: the fewest changed classes, then spikes. Energy and time are those of each chip's own table or clock: they tell what to expect of a chip, not which of two is more efficient.
Energy of loihi-sim: profile davies2018.

loihi-sim and spinnaker1 can run small; xylo-imu cannot. spinnaker1 loses least.

Commands:
  locsnn-compile a
  locsnn-compile b"""


def test_the_picture_marks_what_no_other_chip_beats_and_where_least_is_lost():
    picture = chips_files(DOCUMENT, "5 recordings of few.npz")["explore.svg"].decode()
    # A mark for each chip that runs: two panels of two marks, and one chip whose energy is known.
    marks = 2 + 2 + 1
    marks_of_legend = 3
    assert picture.count("<use ") == marks + marks_of_legend
    assert "spinnaker1: 1.0 % of spikes differ, 350 ms" in picture
    assert "energy per recording" in picture
