"""What the results page says beyond accuracy: broken sensors, answers before the end, and energy against accuracy.

    python tests/results/chip_studies.py --data FOLDER [--only robustness]

Everything is played on the chip's integers with the test part, by the networks that ship and those of ``run_results.py``. Nothing
is chosen here; only networks that hold a validation part back, for margins, are trained. Figures and networks are files under
``--work``, and what is there is not made again. The tables are ``docs/results/NAME.csv``.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from measure_run import CONFIGS, train_network
from result_rows import SEEDS
from results_page import Table, kept, spread, write_table

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import ByteArray
from locsnn_compile.data.division import stratified_split
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.config import config_from_mapping, read_config

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "examples/models"
DRAWS = 5
TAXELS, POLARITIES = 39, 2
SHARES = (0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Shipped:
    """A checkpoint of ``examples/models``, and how its card compiles it."""

    dataset: str
    label: str
    file: str
    strategy: str = "auto"


SHIPPED = (
    Shipped("objects", "Objects, best (Window-SNN and hybrid)", "objects-best.pt", "dendrite"),
    Shipped("objects", "Objects, Hybrid", "objects-hybrid.pt", "dendrite"),
    Shipped("containers", "Containers, best (Window-SNN, levels)", "containers-best.pt"),
    Shipped("containers", "Containers, Hybrid", "containers-hybrid.pt", "dendrite"),
)


EARLY = tuple(
    Shipped("objects", f"Objects, Window-SNN, up to {share} cut in training", f"objects-window-{name}-{seed}.pt")
    for name, share in (("early", "half"), ("quarter", "three quarters"))
    for seed in SEEDS
)
"""Networks of ``--work`` that learned to answer early."""


class Study:
    """The data and the files of figures that all studies share."""

    def __init__(self, data: Path, work: Path, tables: Path) -> None:
        self.data, self.work, self.tables = data, work, tables

    @cache  # noqa: B019 - one study a run
    def part(self, dataset: str, split: str) -> Recordings:
        return read_recordings(self.data / f"Ev-{dataset.title()}.zip", split=split)

    @cache  # noqa: B019
    def program(self, shipped: Shipped) -> hw.ChipProgram:
        own = MODELS / shipped.file
        network = lc.load(own if own.exists() else self.work / shipped.file)
        events = self.part(shipped.dataset, "train").subset(np.arange(16))
        return lc.compile(network, strategy=shipped.strategy, events=events, diagnosis=False).program

    def figures(self, name: str, make: Callable[[], Any]) -> Any:
        """Return what a file holds, or what ``make`` returns, which is kept there."""
        path = self.work / f"{name}.json"
        if not path.exists():
            path.write_text(json.dumps(make()) + "\n", encoding="utf-8")
            print(f"{path.stem}: made", flush=True)
        return json.loads(path.read_text(encoding="utf-8"))


Change = Callable[[ByteArray, np.random.Generator], ByteArray]


def dead_taxels(share: float) -> Change:
    """Silence a share of the taxels, all polarities of each, the same ones in every recording."""

    def change(spikes: ByteArray, rng: np.random.Generator) -> ByteArray:
        taxels = spikes.shape[2] // POLARITIES
        dead = rng.choice(taxels, round(share * taxels), replace=False)
        alive = ~np.isin(np.arange(spikes.shape[2]) // POLARITIES, dead)
        return np.asarray(spikes * alive, dtype=np.uint8)

    return change


def lost_events(share: float) -> Change:
    """Drop each event with this probability."""
    return lambda spikes, rng: np.asarray(spikes * (rng.random(spikes.shape) >= share), dtype=np.uint8)


def clock(rate: float) -> Change:
    """Bin events with a clock that runs at ``rate`` of the right one: an event of step t is read in step rate * t.

    What comes after the last step is lost; events that meet in a bin are one.
    """

    def change(spikes: ByteArray, rng: np.random.Generator) -> ByteArray:
        sample, step, channel = np.nonzero(spikes)
        moved = np.floor((step + 0.5) * rate).astype(np.int64)
        found, held = np.zeros_like(spikes), moved < spikes.shape[1]
        found[sample[held], moved[held], channel[held]] = 1
        return found

    return change


def changes() -> Iterator[tuple[str, Change, int]]:
    """Yield what is wrong with a sensor, in words, what it does to recordings, and how often it is drawn."""
    yield "nothing", lambda spikes, rng: spikes, 1
    for share in SHARES:
        yield f"{round(share * TAXELS)} of {TAXELS} taxels dead ({share:.0%})", dead_taxels(share), DRAWS
    for share in SHARES:
        yield f"{share:.0%} of events lost", lost_events(share), DRAWS
    yield "clock 10 % fast", clock(1.1), 1
    yield "clock 10 % slow", clock(0.9), 1


def robustness(study: Study) -> Table:
    """The accuracy on the chip where the sensor is not what it was in training."""
    rows = []
    for what, change, draws in changes():
        cells = [what]
        for shipped in SHIPPED:

            def measured(shipped: Shipped = shipped, change: Change = change, draws: int = draws) -> list[float]:
                test = study.part(shipped.dataset, "test")
                found = []
                for draw in range(draws):
                    rng = np.random.Generator(np.random.PCG64([draw, 18]))
                    played = hw.simulate(study.program(shipped), change(test.spikes, rng))
                    found.append(float((played.prediction == test.labels).mean()))
                return found

            found = study.figures(f"robust-{Path(shipped.file).stem}-{what.replace(' ', '-')}", measured)
            deviation = f" ± {statistics.stdev(found):.3f}" if len(found) > 1 else ""
            cells.append(f"{statistics.mean(found):.3f}{deviation}")
        rows.append(cells)
    return ["what is wrong", *(shipped.label for shipped in SHIPPED)], rows


SEEN = (0.25, 0.5, 0.75, 1.0)


def seen(study: Study) -> Table:
    """The accuracy on the chip after shares of a recording, and where it is proven that nothing can change."""
    found: dict[str, list[dict[str, Any]]] = {}
    for shipped in (*SHIPPED, *(early for early in EARLY if (study.work / early.file).exists())):

        def measured(shipped: Shipped = shipped) -> dict[str, Any]:
            program, test = study.program(shipped), study.part(shipped.dataset, "test")
            scores = hw.timestep_scores(program, test.spikes)
            right = [
                float((scores[:, int(share * scores.shape[1]) - 1].argmax(axis=1) == test.labels).mean())
                for share in SEEN
            ]
            return {"right": right} | of_stops(program, hw.stop_when_proven(program, test.spikes), test)

        found.setdefault(shipped.label, []).append(study.figures(f"seen-{Path(shipped.file).stem}", measured))
    rows = []
    for label, each in found.items():
        shares = [
            spread(column) if len(column) > 1 else f"{column[0]:.3f}"
            for column in zip(*(f["right"] for f in each), strict=True)
        ]
        rows.append([label, *shares, *saved(each[0])])
    heads = [f"after {share:.0%} of the steps" for share in SEEN[:-1]]
    return ["network", *heads, "at the end", *(f"stopped when proven: {what}" for what in SAVED)], rows


def before(study: Study) -> None:
    """Keep what the hybrids that ship predict of the test part, which pictures compare with the best."""
    for shipped in SHIPPED:

        def predicted(shipped: Shipped = shipped) -> dict[str, Any]:
            test = study.part(shipped.dataset, "test")
            assert test.labels is not None
            played = hw.simulate(study.program(shipped), test.spikes).prediction
            return {
                "classes": 1 + int(test.labels.max()),
                "labels": test.labels.tolist(),
                "predictions": np.asarray(played).tolist(),
            }

        study.figures(f"predicted-{Path(shipped.file).stem}", predicted)


SAVED = ("steps", "of", "energy, µJ", "of, µJ")


def of_stops(program: hw.ChipProgram, stops: hw.Stops, test: Recordings) -> dict[str, float]:
    """Return means of a recording until it stops, and of a whole one."""
    profile, batch = program.chip.profile(program.chip.default_profile), len(stops.steps)
    spent, whole = (sum(hw.energy_pj(counts, profile).values()) / batch for counts in (stops.counts, stops.all_counts))
    return {
        "steps": float(stops.steps.mean()),
        "all_steps": float(stops.all_steps),
        "pj": spent,
        "all_pj": whole,
        "stopped_right": float((stops.prediction == test.labels).mean()),
        "final_right": float((stops.final == test.labels).mean()),
        "same": float((stops.prediction == stops.final).mean()),
    }


def saved(found: Mapping[str, float]) -> list[str]:
    energy = [f"{found[key] / 1e6:.2f}" for key in ("pj", "all_pj")]
    return [f"{found['steps']:.0f}", f"{found['all_steps']:.0f}", *energy]


KEPT = 0.99
"""Share of the final accuracy that a margin keeps on validation recordings."""


def margin_of(scores: np.ndarray[Any, Any], labels: np.ndarray[Any, Any]) -> float:
    """Return the smallest lead at which stops keep ``KEPT`` of the accuracy at the end; scores (batch, steps, classes)."""
    first, second = (np.sort(scores, axis=2)[..., place] for place in (-1, -2))
    lead, right = first - second, scores.argmax(axis=2) == labels[:, None]
    wanted = KEPT * right[:, -1].mean()
    for margin in np.unique(np.quantile(lead[lead > 0], np.linspace(0, 1, 200))):
        enough = lead >= margin
        enough[:, -1] = True
        if right[np.arange(len(right)), enough.argmax(axis=1)].mean() >= wanted:
            return float(margin)
    return float("inf")


@dataclass(frozen=True)
class Held:
    """A network of seed 0 that does not learn from its validation part: what it is called, and how it is trained."""

    dataset: str
    label: str
    file: str
    config: str
    fraction: float


HELD = (
    Held(
        "containers",
        "Containers, Window-SNN, levels",
        "held-containers-window-snn.pt",
        "containers-window-snn-levels",
        0.1667,
    ),
    Held("objects", "Objects, Window-SNN", "held-objects-window-snn.pt", "objects-window-snn", 0.125),
    Held("objects", "Objects, Window-SNN, ends cut", "held-objects-window-early.pt", "objects-window-snn-early", 0.125),
)


def margins(study: Study) -> Table:
    """Answers by margin: found on the validation part of networks that did not learn from it, played on the test part."""
    rows = []
    for held in HELD:
        found = study.figures(Path(held.file).stem, lambda held=held: at_margin(study, held))
        accuracies = [f"{found[key]:.3f}" for key in ("stopped_right", "final_right", "same")]
        rows.append([held.label, str(found["held"]), *accuracies, *saved(found)])
    head = ["network", "validation recordings", "accuracy at the stop", "accuracy at the end", "same prediction"]
    return [*head, *SAVED], rows


def at_margin(study: Study, held: Held) -> dict[str, Any]:
    """Train a network unless it is there, find its margin, and stop the test part by it."""
    recordings, test, path = study.part(held.dataset, "train"), study.part(held.dataset, "test"), study.work / held.file
    if not path.exists():
        values = read_config(CONFIGS / f"{held.config}.yaml")
        own = {"seed": 0, "refit": False, "validation_fraction": held.fraction}
        train_network(path, config_from_mapping(values | own), recordings, None)
    learned, kept_back = stratified_split(recordings.labels, held.fraction, 0)
    events = recordings.subset(learned[:16])
    program = lc.compile(lc.load(path), events=events, diagnosis=False).program
    margin = margin_of(hw.timestep_scores(program, recordings.spikes[kept_back]), recordings.labels[kept_back])
    found = of_stops(program, hw.stop_at_margin(program, test.spikes, margin), test)
    return found | {"margin": margin, "held": len(kept_back)}


@dataclass(frozen=True)
class Point:
    """A point of the front: the networks of a seed, which are joined where there are several, and how they are compiled.

    ``{}`` in a file stands for the seed; a file without it ships with the project.
    """

    dataset: str
    label: str
    kind: str
    files: tuple[str, ...]
    strategy: str = "auto"
    bits: int = 8


WINDOWS, JOINED, COMMITTEE = "windows", "windows and hybrid", "committee"
PROTOTYPES, LEVELS = "Window-SNN, prototypes", "Window-SNN, neighbouring levels"
POINTS = (
    Point("objects", "Window-SNN and hybrid, joined", JOINED, ("objects-windows-and-hybrid-{}.pt",), "dendrite"),
    Point("objects", "Window-SNN and hybrid, joined", JOINED, ("objects-windows-and-hybrid-{}.pt",), "reset"),
    *(Point("objects", PROTOTYPES, WINDOWS, ("objects-window-prototypes-{}.pt",), bits=bits) for bits in (8, 4, 2)),
    *(Point("containers", LEVELS, WINDOWS, ("containers-window-snn-levels-{}.pt",), bits=bits) for bits in (8, 4, 2)),
    *(Point("containers", PROTOTYPES, WINDOWS, ("containers-window-prototypes-{}.pt",), bits=bits) for bits in (8, 4)),
    Point(
        "containers", f"{LEVELS}, and Hybrid trained for the chip", COMMITTEE,
        ("containers-window-snn-levels-{}.pt", "containers-hybrid-loihi.pt"),
    ),
)  # fmt: skip
KNOWN = {
    "Hybrid, lambda 1, loop": "hybrid",
    "Hybrid, lambda 0.5, loop": "hybrid",
    "Tactile-SNN": "hybrid",
    "Window-SNN": WINDOWS,
}
"""Rows of ``chip.csv`` that are points, too, all at 8 bits."""


def front(study: Study) -> Table:
    """Energy and accuracy on the chip: windows, hybrids and committees, down to 2 bits, over five seeds."""
    rows = []
    for point in POINTS:
        found = []
        for seed in SEEDS:
            names = [name.format(seed) for name in point.files]
            paths = [
                study.work / name if "{}" in given else MODELS / name
                for given, name in zip(point.files, names, strict=True)
            ]
            if all(path.exists() for path in paths):
                stem = f"front-{'+'.join(path.stem for path in paths)}-{point.strategy}-{point.bits}"
                found.append(study.figures(stem, lambda point=point, paths=paths: of_point(study, point, paths)))
        if found:
            accuracy, pj = spread([each["right"] for each in found]), statistics.mean(each["pj"] for each in found)
            how = f"{point.strategy}, {point.bits} bits"
            cores = f"{statistics.mean(each['cores'] for each in found):.0f}"
            rows.append([point.dataset.title(), point.label, point.kind, how, accuracy, f"{pj / 1e6:.2f}", cores])
    known = kept(study.tables / "chip.csv")
    for row in known[1] if known else ():
        label, _, dataset = row[0].rpartition(", ")
        if label in KNOWN and dataset in ("Objects", "Containers"):
            how = "auto, 8 bits" if KNOWN[label] == WINDOWS else "dendrite, 8 bits"
            rows.append([dataset, label, KNOWN[label], how, row[2], row[5], ""])
    for dataset, strategy, bits, accuracy, energy in trained_for_the_chip(study.tables):
        rows.append(
            [dataset, "Hybrid, trained for the chip", "hybrid", f"{strategy}, {bits} bits", accuracy, energy, ""]
        )
    return ["set", "network", "kind", "compiled", "accuracy on the chip", "energy, µJ", "cores"], rows


def of_point(study: Study, point: Point, paths: Sequence[Path]) -> dict[str, float]:
    """Compile the networks of a seed, check them on the test part, and return accuracy, energy and cores."""
    networks, events = [lc.load(path) for path in paths], study.part(point.dataset, "test")
    one = networks if len(networks) > 1 else networks[0]
    weights = None if len(networks) == 1 else [1.0, 0.1]  # the count_scale of either
    compiled = lc.compile(
        one, strategy=point.strategy, weight_bits=point.bits, events=events, diagnosis=False, weights=weights
    )
    report = compiled.report
    return {
        "right": report["accuracy"]["chip"],
        "pj": report["energy"]["per_sample_pj"],
        "cores": report["resources"]["cores"],
        "members": report["model"].get("members", []),
    }


def trained_for_the_chip(tables: Path) -> list[list[str]]:
    """Return (set, strategy, bits, accuracy, energy) of the hybrids that ``tests/benchmarks/target_aware.py`` trained."""
    found = []
    for path in sorted(tables.parent.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if "<!-- target-aware: begin -->" in text:
            part = text.partition("<!-- target-aware: begin -->")[2].partition("<!-- target-aware: end -->")[0]
            cells = [
                [cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line[:1] == "|"
            ]
            found += [[row[0], row[1], row[2], row[3], row[6]] for row in cells[2:] if row[6]]
    return found


TABLES: Mapping[str, Callable[[Study], Table]] = {
    "robustness": robustness,
    "time-seen": seen,
    "margins": margins,
    "front": front,
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/results")
    parser.add_argument("--tables", type=Path, default=ROOT / "docs/results")
    parser.add_argument("--only", nargs="*", choices=tuple(TABLES), default=tuple(TABLES))
    args = parser.parse_args(arguments)
    args.work.mkdir(parents=True, exist_ok=True)
    study = Study(args.data, args.work, args.tables)
    before(study)
    for name in args.only:
        write_table(args.tables / f"{name}.csv", TABLES[name](study))


if __name__ == "__main__":
    main()
