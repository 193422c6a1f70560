"""The part of ``locsnn run`` that stops recordings early: the margin, and what it saves."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hw_model as hw
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cli.step_options import read_for_program
from locsnn_compile.errors import InputError

if TYPE_CHECKING:
    from locsnn_compile.cluster.spread import Spread
    from locsnn_compile.data.recordings import Recordings

Row = dict[str, Any]
MIN_AGREEMENT = 0.99


def known_margin(args: argparse.Namespace, program: hw.ChipProgram) -> Row:
    """Return the margin, as given or calibrated, and how it came; infinite where no lead was enough."""
    if args.margin is not None:
        return {"margin": args.margin, "calibrated_on": None}
    import numpy as np

    asked = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
    recordings, part = _calibration(args, program)
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


def find_stops(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    rows: list[Row],
    margin: Row | None,
    spread: Spread,
) -> Row:
    """Stop every recording; add its ``stop`` to the rows and return what is saved, and what it costs in agreement."""
    import numpy as np

    from locsnn_compile.verification.over_time import savings, stop_all

    if args.silence is not None:
        stop = partial(hw.stop_in_silence, program, silence=args.silence)
    elif margin is None:
        stop = partial(hw.stop_when_proven, program)
    else:
        stop = partial(hw.stop_at_margin, program, margin=margin["margin"], psi=args.psi)
    with progress_bar("stopping", show=True) as progress:
        stops = stop_all(stop, recordings.spikes, progress, spread=spread)
    for row, step, prediction in zip(rows, stops.steps.tolist(), stops.prediction.tolist(), strict=True):
        row["stop"] = {"step": step, "prediction": prediction}
    saved = savings(program, stops)
    # JSON has no infinity: no lead at which to stop is null.
    how = {} if margin is None else {**margin, "margin": margin["margin"] if np.isfinite(margin["margin"]) else None}
    labels = recordings.labels
    return {
        "kind": args.stop,
        **how,
        **asdict(saved),
        "agreement": float(np.mean(stops.prediction == stops.final)),
        "accuracy": None if labels is None else float(np.mean(stops.prediction == labels)),
        "whole_accuracy": None if labels is None else float(np.mean(stops.final == labels)),
        "recordings": len(rows),
    }


def stop_lines(found: Row) -> list[str]:
    """Return where the margin comes from, what is saved, and how predictions compare, a line each."""
    from locsnn_compile.report.format import count, energy, plural, share, time

    lines = []
    calibrated = found.get("calibrated_on")
    if calibrated:
        part = f", {calibrated['part']} part" if calibrated["part"] else ""
        lead = "no lead is" if found["margin"] is None else f"a lead of {found['margin']:.4g} is"
        lines.append(
            f"margin: {lead} enough for {share(calibrated['min_agreement'])} agreement on "
            f"{plural(calibrated['recordings'], 'recording')} of {calibrated['source']}{part}"
        )
    saved = {key: 1 - found[key] / found[f"all_{key}"] if found[f"all_{key}"] else 0.0 for key in _SAVED}
    lines.append(
        f"stopped ({found['kind']}) after {count(found['steps'])} of {count(found['all_steps'])} steps on average, "
        f"{share(saved['steps'])} saved; {share(saved['synaptic_ops'])} of synaptic operations; "
        f"{share(saved['energy_pj'])} of energy, {energy(found['energy_pj'])} instead of "
        f"{energy(found['all_energy_pj'])}, and {time(found['latency_ns'])} instead of "
        f"{time(found['all_latency_ns'])} (profile {found['profile']})"
    )
    same = f"as the whole recording in {share(found['agreement'])} of {plural(found['recordings'], 'recording')}"
    if found["accuracy"] is not None:
        same += f"; accuracy {found['accuracy']:.3f} instead of {found['whole_accuracy']:.3f}"
    return [*lines, f"predicted {same}"]


_SAVED = ("steps", "synaptic_ops", "energy_pj")


def _calibration(args: argparse.Namespace, program: hw.ChipProgram) -> tuple[Recordings, str | None]:
    """Return the recordings to calibrate on, never those that are played, and their part of the archive."""
    from locsnn_compile.data.read import recording_parts

    parts = recording_parts(args.calibrate, test_share=args.split)
    part = "train" if "train" in parts else None
    if part is None and Path(args.calibrate).resolve() == Path(args.events).resolve():
        raise InputError(
            f"--calibrate {Path(args.calibrate).name!r}",
            "these recordings are played, too, and a margin always fits those that it was found on",
            fix="Give others.",
        )
    return read_for_program(args, args.calibrate, program, part), part
