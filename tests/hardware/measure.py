"""``make hardware``: resources, clock and cycles of the open core, device by device, into docs/hardware.md.

Five placements per device take minutes each; what is placed is kept in ~/.cache/locsnn. ``--only BOARD`` places one board and
leaves the rows of the others as they are.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import hw_model as hw
from hw_model.errors import LocsnnError
from hw_model.rtl.boards import BOARDS
from hw_model.rtl.comparison import compare
from hw_model.rtl.folder import fit
from hw_model.rtl.simulators import sources
from locsnn_compile.api import compile
from locsnn_compile.data.read import read_recordings
from locsnn_compile.frontends import load

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests/benchmarks"))
from page_section import put_section, section_of  # noqa: E402

PAGE = ROOT / "docs/hardware.md"
ROWS = {
    "ulx3s-25f": ("objects-hybrid-loihi", "native"),
    "ulx3s-85f": ("objects-hybrid", "paired-dendrite"),
    "icebreaker": ("objects-hybrid", "reset"),
}
"""By board: a network that ships, and the strategy with which it is placed."""
STRATEGIES = ("dendrite", "delay-line", "reset")
HEAD = """\
| board | program | LUTs | flip-flops | block RAMs | multipliers | slowest clock |
| --- | --- | ---: | ---: | ---: | ---: | ---: |"""


def compiled(model: str, target: str, strategy: str) -> hw.ChipProgram:
    """Return the program that ``locsnn-compile`` makes."""
    network = load(ROOT / f"examples/models/{model}.pt")
    asked = strategy if model == "objects-hybrid" else "auto"
    return compile(network, target, asked, diagnosis=False).program


def placed(board: str, seeds: int) -> str:
    """Return the row of a board; what cannot be placed is said in it."""
    model, strategy = ROWS[board]
    program = compiled(model, BOARDS[board], strategy)
    name = f"| `{board}` | `{model}`, `{strategy}` |"
    try:
        found, _ = fit(program, board, seeds)
    except LocsnnError as error:
        return f"{name} not placed: {error.measured or error.what} |||||"
    cells = " | ".join(f"{found[key]:,}" for key in ("luts", "flip_flops", "block_rams", "multipliers"))
    return f"{name} {cells} | {found['fmax_mhz']:.1f} MHz of {seeds} |"


def played(strategy: str, recordings: np.ndarray) -> str:
    """Return the row of a strategy on the recordings that ship: what differs, and the cycles."""
    found = compare(compiled("objects-hybrid", "loihi-sim", strategy), recordings, sources())
    different = found["mismatches"] + found["cycle_mismatches"]
    return f"| `{strategy}` | {found['compared_values']:,} | {different} | {np.mean(found['cycles']):,.0f} |"


def main() -> None:
    """Measure, and write the sections."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=BOARDS)
    parser.add_argument("--seeds", type=int, default=5)
    args = parser.parse_args()
    before = (section_of(PAGE.read_text("utf-8"), "placed") or "").splitlines()
    rows = []
    for board in BOARDS:
        kept = [line for line in before if line.startswith(f"| `{board}` |")]
        rows += kept if args.only not in (None, board) else [placed(board, args.seeds)]
    put_section(PAGE, "placed", "\n".join([HEAD, *rows]))
    if args.only is None:
        recordings = read_recordings(str(ROOT / "examples/recordings/touches.npz")).spikes
        head = "| eight recordings of `touches.npz` on Objects | values compared | different | cycles per recording |"
        table = [head, "| --- | ---: | ---: | ---: |", *(played(name, recordings) for name in STRATEGIES)]
        put_section(PAGE, "played", "\n".join(table))


if __name__ == "__main__":
    main()
