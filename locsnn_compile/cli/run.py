"""``locsnn run``: play recordings to a compiled program."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from locsnn_compile.cli.shell import progress_bar

if TYPE_CHECKING:
    import hw_model as hw
    from locsnn_compile.data.recordings import Recordings

_EXAMPLE = """\
example:
  locsnn run build/objects-hybrid --events examples/recordings/touches.npz
"""
_CHUNK = 16


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the ``run`` command."""
    parser = subparsers.add_parser(
        "run",
        help="play recordings to a compiled program",
        description="Play recordings to a compiled program: predictions, counts and energy, without the float network.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("program", metavar="DIR", help="folder that locsnn-compile wrote")
    add("--events", required=True, metavar="FILE", help="recordings: .zip, folder, .npy, .npz, .pt, .tact")
    add("--engine", default="fast", metavar="NAME", help="fast or reference (default fast); equal integers")
    add("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line each, or JSON."""
    import hw_model as hw
    from locsnn_compile.data.read import read_recordings

    program = hw.load_program(args.program)
    recordings = read_recordings(args.events)
    rows, counts = _play(program, recordings, args.engine)
    totals = hw.energy_pj(counts, program.chip.profile(program.chip.default_profile))
    if args.json:
        result = {"program": program.name, "recordings": rows, "counts": dict(counts), "energy_pj": totals}
        print(json.dumps(result, indent=2))
        return 0
    for row in rows:
        right = "" if row["label"] is None else f"  label {row['label']}"
        print(f"recording {row['recording']}: class {row['prediction']}{right}  {row['spikes']} spikes")
    known = [row for row in rows if row["label"] is not None]
    if known:
        accuracy = sum(row["prediction"] == row["label"] for row in known) / len(known)
        print(f"accuracy {accuracy:.3f} on {len(known)} recordings")
    print(
        f"mean of a recording: {counts.synaptic_ops / len(rows):.0f} synaptic operations, "
        f"{sum(totals.values()) / len(rows) / 1e6:.2f} µJ (profile {program.chip.default_profile}), "
        f"{counts.wraps} wraps and {counts.clips} clips in all"
    )
    return 0


def _play(program: hw.ChipProgram, recordings: Recordings, engine: Any) -> tuple[list[dict[str, Any]], hw.Counts]:
    import hw_model as hw
    from locsnn_compile.errors import InputError

    if program.readout is None:
        raise InputError(f"program {program.name!r}", "has no readout, so it predicts nothing", fix="Compile a model.")
    rows: list[dict[str, Any]] = []
    counts = hw.Counts()
    with progress_bar("simulating", show=True) as progress:
        for start in range(0, len(recordings), _CHUNK):
            found = hw.simulate(program, recordings.spikes[start : start + _CHUNK], engine=engine)
            counts = counts + found.counts
            for i, (prediction, one) in enumerate(zip(found.prediction, found.per_recording, strict=True), start):
                label = None if recordings.labels is None else int(recordings.labels[i])
                rows.append({"recording": i, "prediction": int(prediction), "label": label, "spikes": one.spikes})
            if progress:
                progress(len(rows), len(recordings))
    return rows, counts
