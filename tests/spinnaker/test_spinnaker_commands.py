"""The command line with SpiNNaker: compile, run, list targets, and refuse options that have no meaning for it."""

from __future__ import annotations

import json

import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main

MODEL = "examples/models/objects-hybrid.pt"
TOUCHES = "examples/recordings/touches.npz"


def compile_hybrid(folder, *options: object, target: str = "spinnaker1") -> int:
    """Compile the shipped hybrid into a folder, and return the exit code."""
    arguments = [MODEL, "--target", target, "--events", TOUCHES, "--quiet", "-o", folder]
    return compile_main([str(argument) for argument in (*arguments, *options)])


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder of a build with a script for sPyNNaker."""
    folder = tmp_path_factory.mktemp("built") / "build"
    assert compile_hybrid(folder, "--strategy", "reset", "--emit", "pynn", "program") == 0
    return folder


def test_a_model_becomes_a_build_with_a_script_for_spynnaker(built):
    names = {str(path.relative_to(built)) for path in built.rglob("*") if path.is_file()}
    assert names == {
        *("program.yaml", "program.npz", "report.json", "report.md", "report.html", "program.txt"),
        *("spinnaker/network.py", "spinnaker/network.npz", "spinnaker/expected.npz"),
    }
    assert (built / "program.txt").read_text().splitlines()[0] == (
        "program objects-hybrid for spinnaker1"
    )


def test_its_program_runs_with_the_counts_of_the_report(built, capsys):
    report = json.loads((built / "report.json").read_text())
    assert main(["run", str(built), "--events", TOUCHES]) == 0
    lines = capsys.readouterr().out.splitlines()
    classes = [line.split("  ")[0] for line in lines[:8]]
    assert classes == [
        f"recording {number}: class {predicted}"
        for number, predicted in enumerate([17, 2, 2, 2, 17, 2, 2, 2])
    ]
    operations = report["operations"]["per_sample"]["synaptic_ops"]
    assert lines[8] == (
        f"mean per recording: {operations:,.0f} synaptic operations; 0 wraps and 0 saturated "
        "weights in all; energy is not known"
    )


@pytest.mark.slow
def test_both_engines_give_the_same_output(built, capsys, tmp_path):
    outputs = []
    for engine in ("fast", "reference"):
        command = ["run", str(built), "--events", TOUCHES, "--json", "--engine", engine]
        assert main(command) == 0
        outputs.append(json.loads(capsys.readouterr().out))
    fast, reference = outputs
    assert fast == reference
    assert fast["energy_pj"] is None
    assert fast["counts"]["saturated_weights"] == 0


def test_compiling_again_gives_the_same_bytes(built, tmp_path):
    assert compile_hybrid(tmp_path / "again", "--emit", "pynn", "program") == 0
    for path in built.rglob("*"):
        if path.is_file():
            assert (tmp_path / "again" / path.relative_to(built)).read_bytes() == path.read_bytes()


def test_python_compiles_by_the_name_of_the_target(built):
    network = lc.load(MODEL)
    compiled = lc.compile(network, target="spinnaker1", events=TOUCHES)
    assert isinstance(compiled, lc.CompiledSpinnaker)
    assert compiled.files()["program.npz"] == (built / "program.npz").read_bytes()


def test_targets_lists_the_chip_with_its_kind(capsys):
    assert main(["targets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = lines.index("spinnaker1: 856 cores of 256 neurons, 256 synapses of a source on a core")
    assert lines[first + 1] == (
        "  a SpiNNaker with IF_curr_exp: single compartments, 1 ms a step; energy is not known"
    )


REFUSED = {
    "a strategy that joins compartments": (
        ("--strategy", "dendrite"),
        "strategy: it joins compartments, and a neuron of spinnaker1 is a single one (got dendrite). "
        "Use strategy reset.",
    ),
    "other weights": (
        ("--weight-bits", 4),
        "weight_bits: weights for spinnaker1 are rounded to one width (got 4). Leave it out.",
    ),
    "split weights": (
        ("--split-weights", 0.5),
        "split_weights: weights for spinnaker1 are rounded once (got 0.5). Leave it out.",
    ),
    "a profile": (
        ("--profile", "loihi"),
        "profile 'loihi': no table of the energies of spinnaker1 was checked. Leave it out.",
    ),
    "a scheduler": (
        ("--scheduler", "tcp://127.0.0.1:1"),
        "scheduler: recordings are played to spinnaker1 in this process. Leave it out.",
    ),
    "a kind of file that shows compartments": (
        ("--emit", "rtl"),
        "--emit rtl: it shows compartments, cores of a mesh or a board, and spinnaker1 has none of "
        "them. Use --emit network, --emit quantized, --emit program or --emit pynn.",
    ),
}


@pytest.mark.parametrize(("options", "message"), REFUSED.values(), ids=REFUSED)
def test_options_without_a_meaning_for_spinnaker_are_refused(options, message, tmp_path, capsys):
    assert compile_hybrid(tmp_path / "out", *options) == 2
    assert capsys.readouterr().err.strip() == message
    assert not (tmp_path / "out").exists()


def test_other_targets_do_not_write_its_script(tmp_path, capsys):
    assert compile_hybrid(tmp_path / "out", "--emit", "pynn", target="loihi-sim") == 2
    assert capsys.readouterr().err.strip() == (
        "--emit pynn: it describes a SpiNNaker, and loihi-sim is none. Compile for one, such as "
        "--target spinnaker1."
    )


@pytest.mark.parametrize("option", ["--stream", "--psi=2", "--scheduler=tcp://127.0.0.1:1"])
def test_options_of_other_programs_are_refused(built, option, capsys):
    assert main(["run", str(built), "--events", TOUCHES, option]) == 2
    name = option.partition("=")[0]
    assert capsys.readouterr().err.startswith(f"{name}: ")


def test_a_build_below_the_minimum_agreement_fails_its_gate(tmp_path, capsys):
    assert compile_hybrid(tmp_path / "out", "--strategy", "reset", "--min-agreement", "0.1") == 0
    assert compile_hybrid(tmp_path / "out", "--strategy", "reset", "--min-agreement", "0.9") == 3
    assert capsys.readouterr().err.splitlines()[-1] == (
        "gate failed: --min-agreement: prediction agreement is 0.2500, below 0.9."
    )


def test_a_budget_that_can_choose_nothing_is_refused():
    network = lc.load(MODEL)
    with pytest.raises(lc.InputError) as refused:
        lc.compile(network, "spinnaker1", budget=lc.ErrorBudget(max_spike_error=0.0))
    assert str(refused.value) == (
        "budget: there is one setting for spinnaker1, and a budget chooses among several. "
        "Leave it out, and look at the match of the report."
    )
