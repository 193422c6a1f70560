"""What people expect of any command line: a version, a module to run, logs, a file of options, and messages with the
paths that they typed.
"""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.compile import parser as compile_parser
from locsnn_compile.cli.main import COMMANDS, main, parser

ROOT = Path(__file__).parents[2]
MODEL = str(ROOT / "examples/models/objects-hybrid.pt")
TOUCHES = str(ROOT / "examples/recordings/touches.npz")


def refused(capsys, run, *words):
    """Return the one line on standard error of a command that exits with 2."""
    try:
        code = run(list(words))
    except SystemExit as exit_:
        code = exit_.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    return printed.err


@pytest.mark.parametrize(("run", "name"), [(main, "locsnn"), (compile_main, "locsnn-compile")], ids=["locsnn", "locsnn-compile"])  # fmt: skip
def test_the_version(run, name, capsys):
    with pytest.raises(SystemExit) as caught:
        run(["--version"])
    assert (caught.value.code, capsys.readouterr().out) == (0, f"{name} {lc.__version__}\n")
    assert re.fullmatch(r"\d+\.\d+\.\d+", lc.__version__)


def test_the_package_runs_as_a_module():
    process = subprocess.run(
        [sys.executable, "-m", "locsnn_compile", "--version"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stdout, process.stderr) == (
        0,
        f"locsnn {lc.__version__}\n",
        "",
    )


def test_compile_is_a_command_with_the_same_options():
    words = ["m.pt", "--target", "tiny-sim", "--emit", "vcd", "--psi", "3"]
    program_options, command_options = (
        vars(compile_parser().parse_args(words)),
        vars(parser().parse_args(["compile", *words])),
    )
    assert command_options.pop("run").args == ("compile",)
    assert program_options == command_options


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_can_be_verbose(command):
    (parsers,) = (
        action.choices for action in parser()._actions if isinstance(action.choices, dict)
    )
    assert "--verbose" in parsers[command]._option_string_actions


@pytest.fixture
def levels():
    """Leave the loggers as they were."""
    root, ours = logging.getLogger(), logging.getLogger("locsnn")
    before = (list(root.handlers), ours.level)
    root.handlers.clear()
    yield
    root.handlers[:] = before[0]
    ours.setLevel(before[1])


@pytest.mark.slow
def test_a_verbose_command_says_what_it_does(tmp_path, capsys, levels):
    words = [
        MODEL,
        "--events",
        TOUCHES,
        "--strategy",
        "dendrite",
        "--quiet",
        "-o",
        str(tmp_path / "build"),
    ]
    logging.getLogger().handlers.clear()  # as in a process of its own
    assert main(["compile", *words, "--verbose"]) == 0
    stderr = capsys.readouterr().err
    assert re.search(
        r"^objects-hybrid: dendrite, \d+ cores of loihi-sim$", stderr, flags=re.MULTILINE
    )


def test_there_is_one_logger():
    """Of ours; those of Dask are told to be silent."""
    loggers = set()
    for package in ("hw_model", "locsnn_compile"):
        for path in (ROOT / package).rglob("*.py"):
            loggers |= set(re.findall(r"getLogger\((.*?)\)", path.read_text("utf-8")))
    assert loggers == {'"locsnn"', '"distributed"', '"distributed.client"'}


def parsed(tmp_path, text, *words, model="m.pt"):
    """Return what ``locsnn-compile`` parses, with the text as its file of options."""
    (tmp_path / "options.yaml").write_text(text)
    return vars(
        compile_parser().parse_args([model, "--options", str(tmp_path / "options.yaml"), *words])
    )


ALL = "weight-bits: 4\npsi: 1e-3\nemit: [network, vcd]\nprobe: hidden[0]\nquiet: true\nsplit-weights: all\n"


def test_a_file_gives_options(tmp_path):
    options = parsed(tmp_path, ALL)
    words = ["--weight-bits", "4", "--psi", "1e-3", "--emit", "network", "vcd", "--probe", "hidden[0]", "--quiet", "--split-weights", "all"]  # fmt: skip
    assert options | {"options": None} == vars(compile_parser().parse_args(["m.pt", *words]))


def test_the_command_line_wins(tmp_path):
    options = parsed(tmp_path, ALL, "--weight-bits", "8", "--emit", "trace", "--psi=2")
    assert (options["weight_bits"], options["emit"], options["psi"], options["quiet"]) == (
        8,
        ["trace"],
        2.0,
        True,
    )
    assert options["probe"] == ["hidden[0]"]


def test_a_file_serves_the_other_name_of_the_command(tmp_path):
    (tmp_path / "o.yaml").write_text("weight-bits: 4\n")
    args = parser().parse_args(["compile", "m.pt", "--options", str(tmp_path / "o.yaml")])
    assert (args.weight_bits, args.model) == (4, ["m.pt"])


# Each row: its id, the text of a file of options, and how the message goes on after the name of the file.
BAD = [
    ("an unknown option", "weight-bit: 4\n", ": key 'weight-bit' is not known. Did you mean 'weight-bits'?"),
    ("not an option of the file", "options: o.yaml\n", ": key 'options' is not known. "),
    ("a number that is none", "weight-bits: four\n", ", weight-bits: it is not a value of this option (got 'four'). Correct the value."),
    ("a list for one value", "weight-bits: [4, 8]\n", ", weight-bits: it is not a value of this option (got [4, 8]). Correct the value."),
    ("a number out of range", "psi: -1\n", ", psi: it is out of range (got -1). Give a number from 0 up."),
    ("nothing", "target:\n", ", target: it is not a value of this option (got None). Correct the value."),
    ("a number for a switch", "quiet: 1\n", ", quiet: it must be true or false (got 1). Correct the value."),
    ("no mapping", "- a\n", ": it is not a mapping (list). Write one 'key: value' per line."),
    ("no YAML", "a: [\n", ": it is not a YAML file. Write one 'key: value' per line."),
    ("a key given twice", "psi: 1\npsi: 2\n", ": the key 'psi' is given twice, again at line 2. Keep one."),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), [row[1:] for row in BAD], ids=[row[0] for row in BAD])
def test_a_file_that_cannot_be_used_is_one_line(text, message, tmp_path, capsys):
    (tmp_path / "o.yaml").write_text(text)
    path = str(tmp_path / "o.yaml")
    line = refused(capsys, compile_main, "m.pt", "--options", path)
    assert line.startswith(f"options {path!r}{message}")
    assert line.count("\n") == 1


def test_a_file_of_options_that_is_not_there(tmp_path, capsys):
    line = refused(capsys, compile_main, "m.pt", "--options", "no/such.yaml")
    assert (
        line
        == "options 'no/such.yaml': it cannot be read (No such file or directory). Check the path.\n"
    )


def test_a_file_of_options_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "report.json").write_text("quiet: true\n")
    words = [MODEL, "--options", str(tmp_path / "report.json"), "-o", str(tmp_path)]
    assert refused(capsys, compile_main, *words) == f"-o {str(tmp_path)!r}: it would overwrite 'report.json' (--options). Write somewhere else.\n"  # fmt: skip


# Each row: its id, a program with its arguments, and the line on standard error.
TYPED = [
    ("a model", (compile_main, "no/such.pt"), "checkpoint 'no/such.pt': it cannot be read (No such file or directory). Check the path."),
    ("events", (compile_main, MODEL, "--events=no/such.npz"), "file 'no/such.npz': it does not exist. Check the path."),
    ("data", (main, "train", "--data", "./no/such.npz"), "file './no/such.npz': it does not exist. Check the path."),
    ("a configuration", (main, "train", "--data", TOUCHES, "--config", "a/b.yaml"), "config 'a/b.yaml': it cannot be read (No such file or directory). Check the path."),
    ("a name", (compile_main, "such.pt"), "checkpoint 'such.pt': it cannot be read (No such file or directory). Check the path."),
    ("a model mistyped", (compile_main, MODEL.replace("hybrid", "hybird")), f"checkpoint {MODEL.replace('hybrid', 'hybird')!r}: it cannot be read (No such file or directory). Did you mean {MODEL!r}?"),
    ("a folder mistyped", (main, "events", TOUCHES.replace("recordings", "recording")), f"file {TOUCHES.replace('recordings', 'recording')!r}: it does not exist. Did you mean {TOUCHES!r}?"),
    ("two of one name", (compile_main, "a/such.pt", "--events", "b/such.pt"), "checkpoint 'such.pt': it cannot be read (No such file or directory). Check the path."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("call", "message"), [row[1:] for row in TYPED], ids=[row[0] for row in TYPED]
)
def test_an_error_shows_the_path_that_was_typed(call, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert refused(capsys, *call) == f"{message}\n"


def test_a_folder_is_not_mistaken_for_a_file_of_like_name(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("touch-snn.pt").touch()
    line = refused(capsys, main, "run", "touch-snn", "--events", "x.npz")
    assert line == (
        "program 'touch-snn', program.yaml: it cannot be read (No such file or directory). "
        "Give the folder that the compiler wrote.\n"
    )


# By id: a program, its arguments, and how the message begins.
EMPTY = {
    "an output": (compile_main, ["net.pt", "-o", ""], "locsnn-compile: argument -o/--output"),
    "a file that is written": (main, ["diff", "a", "b", "--html="], "locsnn diff: argument --html"),
    "an option with a default": (
        main,
        ["targets", "--show", ""],
        "locsnn targets: argument --show",
    ),
    "one of several": (
        compile_main,
        ["net.pt", "--probe", "a", "--probe", ""],
        "locsnn-compile: argument --probe",
    ),
    "an argument": (main, ["events", ""], "locsnn events: argument FILE"),
    "a value in the file of options": (
        compile_main,
        ["net.pt", "--options", "empty.yaml"],
        "locsnn-compile: argument --profile",
    ),
}


@pytest.mark.parametrize(("run", "words", "argument"), EMPTY.values(), ids=EMPTY)
def test_an_empty_value_is_refused(run, words, argument, tmp_path, monkeypatch, capsys):
    """It is mostly a variable of a shell that is not set; some commands took it for an option that was not given."""
    monkeypatch.chdir(tmp_path)
    Path("empty.yaml").write_text("profile: ''\n")
    program = argument.partition(":")[0]
    assert refused(capsys, run, *words) == f"{argument}: it is empty. See {program} --help.\n"
    assert [path.name for path in tmp_path.iterdir()] == ["empty.yaml"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["complie"],
            "locsnn: COMMAND 'complie' is not known. Did you mean 'compile'? See locsnn --help.\n",
        ),
        (
            ["rtl", "place"],
            "locsnn rtl: COMMAND 'place' is not known. Choose one of: fit, sim, stream. See locsnn rtl --help.\n",
        ),
        ([], "locsnn: the following arguments are required: COMMAND. See locsnn --help.\n"),
        (
            ["diff", "a", "b", "--nope"],
            "locsnn diff: unrecognized arguments: --nope. See locsnn diff --help.\n",
        ),
        (
            ["rtl", "fit", "a", "-x", "3"],
            "locsnn rtl fit: unrecognized arguments: -x 3. See locsnn rtl fit --help.\n",
        ),
    ],
    ids=[
        "misspelt",
        "unknown",
        "none",
        "an unknown option",
        "an unknown option of a command below",
    ],
)
def test_a_command_or_option_that_does_not_exist_is_one_line(words, line, capsys):
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2
    assert capsys.readouterr().err == line


@pytest.mark.parametrize("module", ["locsnn_compile", "locsnn_compile.cli.compile"])
def test_an_interrupt_while_modules_are_imported_is_one_line(module, tmp_path, monkeypatch):
    (tmp_path / "argparse.py").write_text("raise KeyboardInterrupt\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    process = subprocess.run(
        [sys.executable, "-m", module, "model.pt"], capture_output=True, text=True, check=False
    )
    assert (process.stdout, process.stderr) == ("", "Interrupted; nothing was written.\n")
    assert process.returncode != 0


def test_other_errors_are_shown_as_before():
    code = "import locsnn_compile.cli; raise ValueError('no')"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert process.stderr.endswith("ValueError: no\n")
