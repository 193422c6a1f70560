"""``locsnn-compile``: a model file in; a checked chip program and its reports out."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locsnn_compile.cli.shell import EXIT_GATE, Parser, guarded, progress_bar
from locsnn_compile.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from locsnn_compile.api import CompiledModel

_EXAMPLE = """\
example:
  locsnn-compile examples/models/objects-hybrid.pt --events examples/recordings/touches.npz

Without --events the check plays recordings that the model carries, else synthetic touches, and the report says so.
Exit codes: 0 done; 1 the chip cannot hold the model; 2 wrong usage or unreadable input; 3 a gate failed.
"""
_STRATEGY = (
    "lowering of SRM neurons: dendrite, delay-line, reset, or auto, the cheapest within --min-agreement and "
    "--max-spike-error, by default what dendrite keeps (default auto)"
)
EMIT_KINDS = ("network", "quantized", "compartments", "placed", "routed", "program")


def parser() -> Parser:
    """Return the argument parser."""
    made = Parser(
        "locsnn-compile",
        description="Compile a trained spiking network for a neuromorphic chip, check every spike, report the cost.",
        epilog=_EXAMPLE,
        formatter_class=RawDescriptionHelpFormatter,
    )
    add = made.add_argument
    add("model", metavar="MODEL", help="a checkpoint (.pt) that `locsnn train` wrote")
    add("--target", default="loihi-sim", metavar="CHIP", help="chip name or chip file (default loihi-sim)")
    add("-o", "--output", metavar="DIR", help="folder to write (default build/<model name>)")
    add("--events", metavar="FILE", help="recordings to check on: .zip, folder, .npy, .npz, .pt, .tact")
    add("--strategy", default="auto", metavar="NAME", help=_STRATEGY)
    add("--calibration", metavar="FILE", help="recordings that auto decides on; default: the model's own, or synthetic")
    add("--weight-bits", type=int, default=8, metavar="BITS", help="1 to 6, or 8 (default 8)")
    add("--config", metavar="FILE", help="network description, for model formats that need one; a checkpoint does not")
    add("--emit", action="extend", nargs="+", default=[], metavar="KIND", help=f"also write: {', '.join(EMIT_KINDS)}")
    add("--json", action="store_true", help="print report.json to standard output, and nothing else there")
    add("--quiet", action="store_true", help="print nothing")
    add("--min-agreement", type=float, metavar="X", help="exit 3 where prediction agreement is below X (0..1)")
    add("--max-spike-error", type=float, metavar="X", help="exit 3 where more than this share of spikes differs (0..1)")
    add("--max-energy-nj", type=float, metavar="X", help="exit 3 where a recording takes more nanojoules on average")
    add("--max-cores", type=int, metavar="N", help="exit 3 where more cores are used")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    args = parser().parse_args(argv)
    return guarded(lambda: run(args))


def run(args: Namespace) -> int:
    """Compile as ``args`` ask. Raises ``InputError`` and ``TargetError``."""
    for kind in args.emit:
        if kind not in EMIT_KINDS:
            raise InputError(f"--emit {kind}", "no level has this name", fix=did_you_mean(kind, EMIT_KINDS))
    from locsnn_compile.build_folder import check_folder, write_build

    folder = Path(args.output) if args.output else Path("build") / Path(args.model).stem
    check_folder(folder)

    from locsnn_compile.api import compile, recordings_for
    from locsnn_compile.choose_strategy import ErrorBudget
    from locsnn_compile.frontends import load

    network = load(args.model, config=args.config)
    recordings = recordings_for(network, args.events)
    with progress_bar("checking against the float reference", show=not args.quiet) as progress:
        compiled = compile(
            network,
            args.target,
            strategy=args.strategy,
            weight_bits=args.weight_bits,
            events=recordings,
            progress=progress,
            calibration=args.calibration,
            budget=ErrorBudget(args.min_agreement, args.max_spike_error),
        )
    files = build_files(compiled, args.emit)
    write_build(folder, files)
    if args.json:
        sys.stdout.write(files["report.json"].decode())
    elif not args.quiet:
        _print_summary(compiled.report, folder, files)
    return _gates(args, compiled.report)


def build_files(compiled: CompiledModel, emit: Sequence[str]) -> dict[str, bytes]:
    """Return every file of a build as bytes, by name; the same input gives the same bytes."""
    from hw_model.program_file import program_files
    from locsnn_compile.level_text import LEVEL_TEXTS
    from locsnn_compile.report.html import render_html
    from locsnn_compile.report.markdown import render_markdown

    report = compiled.report
    texts = {
        "report.json": json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False) + "\n",
        "report.md": render_markdown(report),
        "report.html": render_html(report),
        **{f"{kind}.txt": LEVEL_TEXTS[kind](compiled.levels) for kind in emit},
    }
    return {**program_files(compiled.program), **{name: text.encode() for name, text in texts.items()}}


def _print_summary(report: dict[str, Any], folder: Path, files: dict[str, bytes]) -> None:
    from rich.console import Console

    from locsnn_compile.report.terminal import render_terminal

    console = Console()
    render_terminal(report, console)
    console.print(f"wrote {folder}/: {', '.join(files)}", markup=False, highlight=False, soft_wrap=True)


def _gates(args: Namespace, report: dict[str, Any]) -> int:
    """Say each gate that failed in a line; return 3 where one did."""
    agreement = report["match"]["prediction_agreement"]
    spike_error = 1 - report["match"]["spike_agreement"]
    energy_nj = report["energy"]["per_sample_pj"] / 1000
    cores = report["resources"]["cores"]
    failed = []
    if args.min_agreement is not None and agreement < args.min_agreement:
        failed.append(f"--min-agreement: prediction agreement is {agreement:.4f}, below {args.min_agreement:g}")
    if args.max_spike_error is not None and spike_error > args.max_spike_error:
        failed.append(f"--max-spike-error: {spike_error:.4f} of the spikes differ, above {args.max_spike_error:g}")
    if args.max_energy_nj is not None and energy_nj > args.max_energy_nj:
        failed.append(f"--max-energy-nj: a recording takes {energy_nj:.1f} nJ, above {args.max_energy_nj:g}")
    if args.max_cores is not None and cores > args.max_cores:
        failed.append(f"--max-cores: {cores} cores are used, above {args.max_cores}")
    for line in failed:
        print(f"gate failed: {line}.", file=sys.stderr)
    return EXIT_GATE if failed else 0


if __name__ == "__main__":
    sys.exit(main())
