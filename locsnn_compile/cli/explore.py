"""``locsnn explore``: what each number of weight bits costs and keeps."""

from __future__ import annotations

import argparse
import json
from typing import Any

from locsnn_compile.cli.shell import progress_bar

_EXAMPLE = """\
example:
  locsnn explore examples/models/objects-hybrid.pt --events examples/recordings/touches.npz --weight-bits 2 4 8
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the ``explore`` command."""
    parser = subparsers.add_parser(
        "explore",
        help="compile with several weight bits and compare",
        description="Compile a model with several weight bits, check each on the same recordings, and compare. "
        "An asterisk marks settings that no other beats in both energy and agreement of predictions.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("model", metavar="MODEL", help="a checkpoint (.pt) that `locsnn train` wrote")
    add("--events", metavar="FILE", help="recordings to check on; default: the model's own, else synthetic touches")
    add("--target", default="loihi-sim", metavar="CHIP", help="chip name or chip file (default loihi-sim)")
    add("--weight-bits", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6, 8], metavar="BITS", help="default: all widths")
    add("--json", action="store_true", help="print the rows as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compile once for each number of bits; print a table, or JSON."""
    from locsnn_compile.api import compile, recordings_for
    from locsnn_compile.frontends import load

    network = load(args.model)
    recordings = recordings_for(network, args.events)
    rows = []
    with progress_bar("compiling", show=True) as progress:
        for done, bits in enumerate(args.weight_bits, 1):
            rows.append(
                _row(compile(network, args.target, weight_bits=bits, events=recordings, diagnosis=False).report)
            )
            if progress:
                progress(done, len(args.weight_bits))
    for row in rows:
        row["on_front"] = not any(_beats(other, row) for other in rows)
    if args.json:
        print(json.dumps(rows, indent=2))
        return 0
    profile = rows[0]["energy_profile"]
    print(f"{network.name} on {args.target}, {len(recordings)} recordings of {recordings.source}, energy by {profile}")
    print("  bits  same class  same spikes  accuracy  energy µJ  synapses  memory kB")
    for row in rows:
        accuracy = "-" if row["accuracy"] is None else f"{row['accuracy']:.3f}"
        print(
            f"{'*' if row['on_front'] else ' '} {row['weight_bits']:4}  {row['prediction_agreement']:10.4f}  "
            f"{row['spike_agreement']:11.4f}  {accuracy:>8}  {row['energy_pj'] / 1e6:9.2f}  {row['synapses']:8}  "
            f"{row['synapse_bits'] / 8000:9.1f}"
        )
    return 0


def _row(report: dict[str, Any]) -> dict[str, Any]:
    return {
        "weight_bits": report["weight_bits"],
        "prediction_agreement": report["match"]["prediction_agreement"],
        "spike_agreement": report["match"]["spike_agreement"],
        "accuracy": None if report["accuracy"] is None else report["accuracy"]["chip"],
        "energy_profile": report["energy"]["profile"],
        "energy_pj": report["energy"]["per_sample_pj"],
        "synapses": report["resources"]["synapses"],
        "synapse_bits": report["resources"]["synapse_bits"],
    }


def _beats(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Tell whether one setting is at least as good in both figures, and better in one."""
    mine = (one["prediction_agreement"], -one["energy_pj"])
    its = (other["prediction_agreement"], -other["energy_pj"])
    return mine != its and mine[0] >= its[0] and mine[1] >= its[1]
