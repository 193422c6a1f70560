"""The margin of ``locsnn run --stop margin``: the lead that is enough to stop, as given or calibrated on recordings."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import hw_model as hw
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cli.step_options import read_for_program
from locsnn_compile.data.read import recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError

MIN_AGREEMENT = 0.99


def known_margin(args: argparse.Namespace, program: hw.ChipProgram, played: Recordings) -> dict[str, Any]:
    """Return the margin and where it comes from, which is not what is ``played``; infinite if no lead was enough."""
    if args.margin is not None:
        return {"margin": args.margin, "calibrated_on": None}
    asked = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
    part = "train" if "train" in recording_parts(args.calibrate, test_share=args.split) else None
    recordings = read_for_program(args, args.calibrate, program, part)
    if np.array_equal(recordings.spikes, played.spikes):
        what = "these recordings are also played, and a margin always suits the recordings that it was found on"
        raise InputError(f"--calibrate {Path(args.calibrate).name!r}", what, fix="Give others.")
    with progress_bar("calibrating", show=True):
        margin = hw.calibrate_margin(program, recordings.spikes, asked, args.psi)
        stops = hw.stop_at_margin(program, recordings.spikes, margin, args.psi)
    return {
        "margin": margin,
        "calibrated_on": {
            "source": recordings.source,
            "part": part,
            "recordings": len(recordings),
            "min_agreement": asked,
            "agreement": float(np.mean(stops.prediction == stops.final)),
        },
    }
