"""``locsnn explore`` with several chips: what each loses and takes, and why others refuse the network."""

import json
import shlex

import pytest
from small_model import explore, explored

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.explore.chips import ChipFigures, ChipsDocument, TriedChip
from locsnn_compile.explore.chips_result import chips_files, chips_lines
from locsnn_compile.explore.document import ExploredEvents, ExploredModel

CHIPS = ("loihi-sim", "ecp5-85f", "spinnaker1", "xylo-audio3")
RESET = ("--strategy", "reset")


def on(*chips):
    return [text for chip in chips for text in ("--target", chip)]


@pytest.fixture(scope="module")
def tried(model, events, tmp_path_factory):
    folder = tmp_path_factory.mktemp("chips") / "out"
    assert explore(model, "--events", events, *RESET, *on(*CHIPS), "-o", folder, "--quiet") == 0
    return folder


def row_of(folder, chip):
    (row,) = (row for row in explored(folder)["chips"] if row["target"] == chip)
    return row


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
    assert compile_main([*arguments, "-o", str(tmp_path / "build")]) == 2
    assert capsys.readouterr().err == f"{row['refused']}\n"
    assert explored(tried)["runs_on"] == list(CHIPS[:3])


def test_the_same_command_writes_the_same_bytes(tried, model, events, tmp_path, capsys):
    again = tmp_path / "again"
    arguments = (model, "--events", events, *RESET, *on(*CHIPS), "-o", again)
    assert explore(*arguments, "--json") == 0
    assert capsys.readouterr().out == (tried / "explore.json").read_text()
    for name in ("explore.json", "explore.csv", "explore.svg"):
        assert (again / name).read_bytes() == (tried / name).read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--weight-bits", 4, 8),
            "--weight-bits: several values are compared on one chip (4, 8). "
            "Give one value, or one --target.\n",
        ),
        (
            ("--engines", "fast"),
            "--engines: engines are timed on one chip. Leave it out, or give one --target.\n",
        ),
        (
            ("--min-agreement", 1),
            "--min-agreement: a setting is recommended on one chip. "
            "Leave it out, or give one --target.\n",
        ),
        (
            ("--workers", 2),
            "--workers: chips are tried one after the other. Leave it out, or give one --target.\n",
        ),
    ],
    ids=["two widths", "engines", "a bound", "workers"],
)
def test_options_of_one_chip_are_refused_for_several(model, tmp_path, capsys, options, message):
    folder = tmp_path / "out"
    assert explore(model, *on(*CHIPS), *options, "-o", folder) == 2
    assert capsys.readouterr().err == message
    assert not folder.exists()


def test_no_chip_that_can_run_it_is_an_error_with_every_sentence(model, tmp_path, capsys):
    folder = tmp_path / "out"
    chips = ("xylo-audio2", "xylo-imu")
    assert explore(model, *on(*chips), "-o", folder, "--quiet") == 2
    error = capsys.readouterr().err
    assert error.startswith("--target: no chip can run it (xylo-audio2: ")
    assert "; xylo-imu: " in error
    assert error.endswith(". Try other chips of locsnn targets.\n")
    assert not (folder / "explore.json").exists()


def figures(spike_error, time_ns=None, energy_pj=None):
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


DOCUMENT = ChipsDocument(
    schema="locsnn-explore-chips/1",
    code="1",
    model=ExploredModel("small", None),
    compared_on=ExploredEvents("few.npz", None, 5, 5),
    runs_on=("loihi-sim", "spinnaker1"),
    lose_least=("spinnaker1",),
    chips=(
        TriedChip("loihi-sim", figures(0.02, 1e6, 2e6), None, "locsnn-compile a"),
        TriedChip("spinnaker1", figures(0.01, 3.5e8), None, "locsnn-compile b"),
        TriedChip("xylo-imu", None, "a population steps over locations.", "locsnn-compile c"),
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
    assert picture.count("<use ") - 3 == 2 + 2 + 1  # operations, times, one energy; a legend of 3
    assert "spinnaker1: 1.0 % of spikes differ, 350 ms" in picture
    assert "energy per recording" in picture
