"""The part of ``locsnn run`` that stops recordings early, and says what that saves and what it costs in agreement."""

import argparse
from functools import partial
from typing import Any

import numpy as np

import hw_model as hw
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cluster.spread import Spread
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.report.words import sentence
from locsnn_compile.verification.over_time import savings, stop_all

Row = dict[str, Any]
_SAVED = ("steps", "synaptic_ops", "energy_pj")


def find_stops(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    rows: list[Row],
    margin: Row | None,
    spread: Spread,
) -> Row:
    """Stop every recording; add its ``stop`` to its row, and return the figures over all of them."""
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
    # JSON has no infinity: null means that no lead was enough.
    how = {} if margin is None else {**margin, "margin": margin["margin"] if np.isfinite(margin["margin"]) else None}
    # A recording in which all classes tie at the end predicts nothing, so it counts as wrong wherever it stops.
    labels = None if recordings.labels is None else np.where([row["tied"] for row in rows], -1, recordings.labels)
    return {
        "kind": args.stop,
        **how,
        **savings(program, stops),
        "agreement": float(np.mean(stops.prediction == stops.final)),
        "accuracy": None if labels is None else float(np.mean(stops.prediction == labels)),
        "whole_accuracy": None if labels is None else float(np.mean(stops.final == labels)),
        "recordings": len(rows),
    }


def stop_lines(found: Row) -> list[str]:
    """Return, a line each, where the margin comes from, what stopping saves, and how predictions compare."""
    lines = []
    if calibrated := found.get("calibrated_on"):
        of_part = f", {calibrated['part']} part" if calibrated["part"] else ""
        lead = "no lead is" if found["margin"] is None else f"a lead of {found['margin']:.4g} is"
        lines.append(sentence("margin", lead=lead, of_part=of_part, **calibrated))
    saved = {key: 1 - found[key] / found[f"all_{key}"] if found[f"all_{key}"] else 0.0 for key in _SAVED}
    priced = sentence("stopped, with costs", saved=saved, **found) if found["profile"] else ""
    right = "" if found["accuracy"] is None else sentence("predicted, with labels", **found)
    stopped = sentence("stopped", saved=saved, **found) + priced
    return [*lines, stopped, sentence("predicted", **found) + right]
