"""viewer.html: data, style, plotting library and script in one file that loads nothing else.

It shows the spikes and potentials of both sides, and what the cores did in every step.
"""

import base64
import json
from typing import Any

import numpy as np

from hw_model.texts.templates import filled
from hw_model.values import AnyArray
from locsnn_compile.network.network import Population
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import text
from locsnn_compile.verification.matching import Divergence
from locsnn_compile.verification.observation import Observation, Observed


def render_viewer(observed: Observed, figures: ReportFigures, first: Divergence | None) -> bytes:
    """Return a page on recordings, as UTF-8; ``first`` is where the sides first differ."""
    report = compose(figures)
    values = viewer_values(observed, first) | {"cores": plain(figures.resources.by_core)}
    data = json.dumps(values, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    page = filled(
        __package__,
        "viewer.html",
        title=text(report.title),
        subtitle=text(report.subtitle),
        data=data,
    )
    return page.encode(errors="backslashreplace")


RECORDINGS = 10
"""Most recordings on a page."""
MOST_TEXT = 1_800_000
"""Most characters of data: with the script and the library, the page stays below 2 MB."""
QUANTITIES = ("synaptic_ops", "spikes", "packets_received")
"""What the mesh shows of each core."""


def viewer_values(observed: Observed, first: Divergence | None) -> dict[str, Any]:
    """Return the data of the page on some of the recordings.

    They are the recording in which the sides ``first`` differ and, while there is room, the first ones. Arrays are
    little-endian and in base64: spikes are numbers ``step * size + neuron``, of the network and of the chip; activity
    is (steps, cores of the phase) for each of :data:`QUANTITIES`.
    """
    levels = observed.levels
    network = levels.network
    labels = observed.labels
    most_telling = first.recording if first else 0
    numbers = list(dict.fromkeys([most_telling, *range(len(observed))]))[:RECORDINGS]
    seen = Observation(levels.quantized, levels.program, observed.recordings[numbers])
    reference, chip = seen.reference, seen.chip
    sides = {
        p.name: (reference.spikes[p.name], chip.spikes[p.name]) for p in network.own_populations
    }
    phases = [phase.name for phase in network.phases]
    views = [view for view in network.views if view.phase in phases]
    given = sides | {view.name: (reference.spikes[view.name],) * 2 for view in views}
    rows: list[dict[str, Any]] = [
        {
            "number": number,
            "label": None if labels is None else int(labels[number]),
            "predictions": [
                int(network.readout.decided(scores[i]))
                for scores in (reference.scores, np.asarray(chip.scores))
            ],
            "spikes": {
                name: [_text(np.flatnonzero(side[i]), "u4") for side in both]
                for name, both in given.items()
            },
            "activity": {
                phase: [_text(steps[i].count(name), "u4") for name in QUANTITIES]
                for phase, steps in chip.activity.items()
            },
        }
        for i, number in enumerate(numbers)
    ]
    while len(rows) > 1 and len(json.dumps(rows)) > MOST_TEXT:
        rows.pop()
    differing = {name: (one != other).sum(axis=(0, 1)) for name, (one, other) in sides.items()}
    if first is not None:
        differing[first.population][first.neuron] = 1 << 40
    kept = _kept(levels, differing, (MOST_TEXT - len(json.dumps(rows))) // len(rows))
    for row in rows:
        row["potentials"] = _potentials(levels, observed.recording(row["number"]), kept)
    populations = [_population(levels, p, kept[p.name]) for p in network.own_populations]
    inputs = [
        {"name": v.name, "axis": v.phase, "size": v.lines, "steps": network.steps_of(v.phase)}
        for v in views
    ]
    shown = {
        "recordings": rows,
        "samples": len(observed),
        "populations": populations,
        "inputs": inputs,
    }
    return shown | {"phases": phases, "first": first and vars(first), "quantities": QUANTITIES}


def _population(levels: Levels, p: Population, kept: list[int]) -> Document:
    """Return a population, with the thresholds of the neurons whose potentials are kept, and its cores."""
    return {
        "name": p.name,
        "axis": p.phase,
        "size": p.size,
        "steps": levels.network.steps_of(p.phase),
        "kept": kept,
        "thresholds": p.thresholds[kept].tolist(),
        "cores": [
            core.number
            for core in levels.program.cores
            if any(s.group == p.name for s in core.slices)
        ],
    }


def _text(values: AnyArray, kind: str) -> str:
    return base64.b64encode(values.astype(f"<{kind}").tobytes()).decode()


def _kept(levels: Levels, differing: dict[str, AnyArray], room: int) -> dict[str, list[int]]:
    """Return the neurons of each population that differ most, as many as fit their potentials into ``room``."""
    populations, most = levels.network.own_populations, max(map(len, differing.values()))
    # Two sides with 2 bytes per step, in base64.
    while (
        most > 1
        and sum(6 * levels.network.steps_of(p.phase) * min(most, p.size) for p in populations)
        > room
    ):
        most = most * 3 // 4
    return {
        name: sorted(np.argsort(-one, kind="stable")[:most].tolist())
        for name, one in differing.items()
    }


def _potentials(
    levels: Levels, seen: Observation, kept: dict[str, list[int]]
) -> dict[str, dict[str, Any]]:
    """Return potentials (2 sides, kept neurons, steps) in 65,536 grades from ``low`` on, in the network's units."""
    reference = seen.reference.potential
    chip = seen.chip.potential
    found = {}
    for name, neurons in kept.items():
        scale = levels.quantized.population(name).scale[neurons]
        sides = np.stack(
            [reference[name][0][:, neurons], chip[name][0][:, neurons] / scale]
        ).swapaxes(1, 2)
        low, grade = float(sides.min()), float(np.ptp(sides)) / 65535 or 1.0
        found[name] = {
            "low": low,
            "grade": grade,
            "values": _text(np.rint((sides - low) / grade), "u2"),
        }
    return found
