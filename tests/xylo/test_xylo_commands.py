"""The command line with a Xylo: compile, run, explore, list targets, and refuse options that have no meaning for it."""

from __future__ import annotations

import itertools
import json
import shlex
from typing import NamedTuple

import nir
import numpy as np
import pytest
import yaml

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main

DT = 1e-3
SHAPE = ("--axes", "samples,steps,channels")
"""The options that say how the arrays of recordings are laid out."""


def cuba_lif(size: int, tau_syn: float, tau_mem: float) -> nir.CubaLIF:
    """Return NIR neurons with a current, scaled so that a weight of 1 adds 1 to the current in a step of DT."""

    def for_all(value: float) -> np.ndarray:
        return np.full(size, value)

    return nir.CubaLIF(
        tau_syn=for_all(tau_syn),
        tau_mem=for_all(tau_mem),
        r=for_all(tau_mem / DT),
        w_in=for_all(tau_syn / DT),
        v_leak=for_all(0.0),
        v_threshold=for_all(1.0),
        v_reset=for_all(0.0),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a small NIR network of leaky neurons, and recordings with labels."""
    place = tmp_path_factory.mktemp("small")
    r = np.random.default_rng(4)
    nodes = {
        "input": nir.Input(np.array([16])),
        "into": nir.Linear(r.normal(0.03, 0.12, (24, 16))),
        "hidden": cuba_lif(size=24, tau_syn=4e-3, tau_mem=8e-3),
        "out of": nir.Linear(r.normal(0.03, 0.15, (4, 24))),
        "classes": cuba_lif(size=4, tau_syn=2e-3, tau_mem=16e-3),
        "output": nir.Output(np.array([4])),
    }
    names = list(nodes)
    edges = list(itertools.pairwise(names))
    nir.write(place / "small-lif.nir", nir.NIRGraph(nodes, edges, type_check=False))
    spikes = (r.random((8, 50, 16)) < 0.15).astype(np.uint8)
    np.savez(place / "touches.npz", spikes=spikes, labels=np.arange(8) % 4)
    return place


def compile_small(folder, *options: object, target: str = "xylo-audio3") -> int:
    """Compile the small network, and return the exit code."""
    model = folder / "small-lif.nir"
    arguments = [model, "--dt", DT, "--target", target, "--events", folder / "touches.npz"]
    return compile_main([str(argument) for argument in (*arguments, *SHAPE, *options)])


@pytest.fixture(scope="module")
def built(folder):
    """The folder of a build of the small network."""
    out = folder / "build"
    assert compile_small(folder, "--reset", "subtract", "-o", out, "--quiet") == 0
    return out


def test_a_nir_graph_becomes_a_build_whose_program_runs(folder, built, capsys):
    assert {path.name for path in built.iterdir()} == {
        "program.yaml",
        "program.npz",
        "report.json",
        "report.md",
        "report.html",
    }
    report = json.loads((built / "report.json").read_text())
    assert main(["run", str(built), "--events", str(folder / "touches.npz"), *SHAPE]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[:8]] == [f"recording {k}" for k in range(8)]
    assert lines[8] == f"accuracy {report['accuracy']['chip']:.3f} on 8 recordings"
    operations = report["operations"]["per_sample"]["synaptic_ops"]
    assert lines[9] == (
        f"mean per recording: {operations:,.0f} synaptic operations; 0 saturations in all; "
        "energy is not known"
    )


def test_both_engines_give_the_same_output(folder, built, capsys):
    outputs = []
    for engine in ("fast", "reference"):
        command = ["run", str(built), "--events", str(folder / "touches.npz"), *SHAPE, "--json"]
        assert main([*command, "--engine", engine]) == 0
        outputs.append(json.loads(capsys.readouterr().out))
    fast, reference = outputs
    assert fast == reference
    assert fast["energy_pj"] is None
    assert fast["counts"]["spikes"] == sum(row["spikes"] for row in fast["recordings"])


def test_the_report_names_the_witness_and_what_is_not_known(built):
    page = (built / "report.md").read_text()
    assert "small-lif on xylo-audio3" in page
    assert "no table of the energies or times of this chip is published" in page
    assert "That the chip computes as xylosim does is the vendor's word: no chip was used." in page


def test_network_and_program_are_emitted_as_text(folder, tmp_path):
    out = tmp_path / "out"
    emit = ("--emit", "network", "program")
    assert compile_small(folder, "--reset", "subtract", "-o", out, "--quiet", *emit) == 0
    assert (out / "network.txt").read_text().startswith("network small-lif: ")
    assert (out / "program.txt").read_text().splitlines()[0] == "program small-lif for xylo-audio3"


def test_gates_hold_and_fail_by_the_report(folder, tmp_path, capsys):
    out = tmp_path / "out"
    common = ("--reset", "subtract", "-o", out, "--quiet")
    assert compile_small(folder, *common, "--min-agreement", "0.1") == 0
    assert compile_small(folder, *common, "--max-energy-nj", "10") == 3
    assert capsys.readouterr().err.splitlines()[-1] == (
        "gate failed: --max-energy-nj: the energy of this target is not known."
    )
    gates = json.loads((out / "report.json").read_text())["gates"]
    assert gates == [{"name": "--max-energy-nj", "bound": 10.0, "measured": None, "passed": False}]


def test_targets_lists_the_three_chips_with_their_kind(capsys):
    assert main(["targets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = lines.index("xylo-audio2: 16 inputs, 1000 hidden neurons of 2 currents, 8 outputs")
    kind = "  a Xylo: leaky neurons with decays by shifts, weights of 8 bits; energy is not known"
    assert lines[first + 1 : first + 6] == [
        kind,
        "xylo-audio3: 16 inputs, 992 hidden neurons of 2 currents, 32 outputs",
        kind,
        "xylo-imu: 16 inputs, 496 hidden neurons of 1 current, 16 outputs",
        kind,
    ]


def test_targets_shows_the_file_of_a_chip(capsys):
    assert main(["targets", "--show", "xylo-imu"]) == 0
    shown = yaml.safe_load(capsys.readouterr().out)
    assert (shown["hidden"], shown["states"]) == (496, 1)


def test_a_network_is_explored_on_chips_with_the_values_that_each_knows(folder, tmp_path, capsys):
    """A setting that the chip does not have is refused, and the other is compiled; its command builds the same."""
    arguments = ["explore", folder / "small-lif.nir", "--dt", DT, "--reset", "subtract", *SHAPE]
    arguments += ["--events", folder / "touches.npz", "--weight-bits", 4, 8]
    arguments += ["--split-weights", "none", "--target", "xylo-audio3", "-o", tmp_path / "out"]
    assert main([*map(str, arguments), "--quiet"]) == 0
    document = json.loads((tmp_path / "out" / "explore.json").read_text())
    refused, compiled = document["chips"]
    assert refused["refused"] == (
        "weight_bits: weights of xylo-audio3 have one width (got 4). Leave it out."
    )
    assert compiled["setting"] == {"weight_bits": 8, "split_weights": 0.0}
    # The command without its first word, which is the program's name.
    command = shlex.split(compiled["command"])[1:]
    assert compile_main([*command, "-o", str(tmp_path / "build")]) == 0
    capsys.readouterr()
    report = json.loads((tmp_path / "build" / "report.json").read_text())
    assert compiled["figures"]["spike_error"] == 1 - report["match"]["spike_agreement"]
    assert compiled["figures"]["energy_pj"] is None


def test_the_stress_test_is_refused_for_a_xylo(capsys):
    assert main(["stress", "--target", "xylo-imu"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        "target 'xylo-imu': a Xylo computes in another way than the chips that can be used here. "
        "Compile for it: locsnn-compile --target."
    )


SUBTRACT = ("--reset", "subtract")


class Refusal(NamedTuple):
    """Options of the compiler, the exit code (1: the network does not fit, 2: wrong options), and the error."""

    options: tuple[str, ...]
    exit_code: int
    message: str


REFUSED_TO_COMPILE = {
    "a name that no chip has": Refusal(
        (*SUBTRACT, "--target", "xylo-audio4"),
        exit_code=2,
        message="target 'xylo-audio4': no Xylo of this name ships. Did you mean 'xylo-audio3'?",
    ),
    "the usual reset": Refusal(
        (),
        exit_code=1,
        message="population 'hidden': a spike resets its potential to 0, and on a Xylo it "
        "subtracts the threshold. Read a NIR graph with --reset subtract, or give SoftCuba "
        "neurons.",
    ),
    "an emitter of cores": Refusal(
        (*SUBTRACT, "--emit", "vectors"),
        exit_code=2,
        message="--emit vectors: it shows compartments, cores or a board, and xylo-audio3 has "
        "none of them. Use --emit network, --emit program or --emit xylo.",
    ),
    "weight bits": Refusal(
        (*SUBTRACT, "--weight-bits", "4"),
        exit_code=2,
        message="weight_bits: weights of xylo-audio3 have one width (got 4). Leave it out.",
    ),
    "a profile": Refusal(
        (*SUBTRACT, "--profile", "loihi-paper"),
        exit_code=2,
        message="profile 'loihi-paper': no energies of xylo-audio3 are published. Leave it out.",
    ),
}


@pytest.mark.parametrize("case", REFUSED_TO_COMPILE)
def test_what_a_xylo_does_not_have_is_refused_in_one_line(case, folder, tmp_path, capsys):
    refusal = REFUSED_TO_COMPILE[case]
    exit_code = compile_small(folder, "-o", tmp_path / "out", *refusal.options)
    assert exit_code == refusal.exit_code
    assert capsys.readouterr().err.splitlines()[-1] == refusal.message
    assert not (tmp_path / "out").exists()


# By option: its words on the command line, and the reason in the error.
REFUSED_TO_RUN = {
    "--stream": (["--stream"], "it plays whole recordings"),
    "--stop": (["--stop", "proven"], "it plays whole recordings"),
    "--profile": (["--profile", "loihi-paper"], "its energies are not published"),
    "--scheduler": (["--scheduler", "tcp://127.0.0.1:1"], "it is played in this process"),
}


@pytest.mark.parametrize("option", REFUSED_TO_RUN)
def test_run_refuses_options_without_a_meaning_for_a_xylo(option, folder, built, capsys):
    options, reason = REFUSED_TO_RUN[option]
    command = ["run", str(built), "--events", str(folder / "touches.npz"), *SHAPE]
    assert main([*command, *options]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"{option}: the program is for xylo-audio3: {reason}. Leave it out."
    )


@pytest.mark.parametrize("command", ["rtl sim", "rtl fit"])
def test_commands_for_cores_name_the_one_that_plays_it(command, folder, built, capsys):
    arguments_of = {
        "rtl sim": [str(built), "--events", str(folder / "touches.npz")],
        "rtl fit": [str(built), "--board", "ulx3s-85f"],
    }
    assert main([*command.split(), *arguments_of[command]]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        "program.yaml: this is a program of another kind (locsnn-xylo-program against "
        "locsnn-program). Play it with `locsnn run`."
    )


def test_run_refuses_recordings_of_another_sensor(built, tmp_path, capsys):
    np.save(tmp_path / "wide.npy", np.zeros((2, 20, 17), np.uint8))
    assert main(["run", str(built), "--events", str(tmp_path / "wide.npy"), *SHAPE]) == 2
    last_line = capsys.readouterr().err.splitlines()[-1]
    assert last_line.endswith(
        "the channel count differs from the program's (17 channels against 16). Give recordings "
        "of 16 channels."
    )


def test_the_same_input_gives_the_same_bytes(folder, built, tmp_path):
    assert compile_small(folder, "--reset", "subtract", "-o", tmp_path / "again", "--quiet") == 0
    for path in built.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name
    entries = yaml.safe_load((built / "program.yaml").read_text())
    assert entries["format"] == "locsnn-xylo-program"
