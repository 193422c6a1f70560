"""Compare ways of training on the train parts of the recordings: what `docs/research/results/tried-training.csv` holds.

    python docs/research/results/try_training.py --data FOLDER --dataset containers --repeats 2 --names base near

The train part is divided into four stratified folds, ``--repeats`` times. Each way of ``tried_settings.yaml`` learns from three of
them and is measured on the fourth after its last epoch, so that nothing is chosen on what measures. **The test part is never read.**
Class scores of the held-out recordings are files under ``--work``: what is there is not made again. The table gets the rows of
``--names``, and keeps the others. Accuracies after shares of the steps are those of recordings that end there; those with a clock
that is off are of recordings whose events it read.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from broken_sensors import clock
from tables import merged, read_table, write_table
from ways import FOLDS, ROOT, Committee, Division, Floats, settings_of

from hw_model.values import ByteArray
from locsnn_compile.data.read import read_recordings

HERE = Path(__file__).parent


def ended(share: float) -> Callable[[ByteArray], ByteArray]:
    """Silence recordings after this share of their steps."""
    return lambda spikes: (
        spikes * (np.arange(spikes.shape[1]) < int(share * spikes.shape[1]))[:, np.newaxis]
    )


def clocked(rate: float) -> Callable[[ByteArray], ByteArray]:
    """Read recordings with a clock that runs at ``rate`` of the right one."""
    change = clock(rate)
    return lambda spikes: change(spikes, np.random.default_rng(0))


PLAYS: Mapping[str, Callable[[ByteArray], ByteArray]] = {
    "accuracy": ended(1.0),
    "three quarters": ended(0.75),
    "half": ended(0.5),
    "quarter": ended(0.25),
    "5 % slow": clocked(0.95),
    "5 % fast": clocked(1.05),
    "10 % slow": clocked(0.9),
    "10 % fast": clocked(1.1),
}
"""How held-out recordings are played; the first play is the whole recording."""
HEAD = ["training", "parts", "accuracy", "standard error", *list(PLAYS)[1:]]


def scores_of(division: Division, name: str) -> Floats | None:
    """Return the log-probabilities (plays, samples, classes) of each recording by the network that did not learn from it.

    A file of scores may have only the first of :data:`PLAYS`. None for a committee whose members have no scores yet.
    """
    way, path = (
        division.way_of_name[name],
        division.work / f"{division.dataset}-{name}-{division.repeat}.npy",
    )
    if isinstance(way, Committee):
        paths = [
            division.work / f"{division.dataset}-{member}-{division.repeat}.npy"
            for member in way.members
        ]
        if not all(member_file.exists() for member_file in paths):
            return None
        member_scores = [
            weight * np.load(member_file)
            for weight, member_file in zip(way.members.values(), paths, strict=True)
        ]
        return np.asarray(sum(scores[: min(map(len, member_scores))] for scores in member_scores))
    if path.exists():
        return np.asarray(np.load(path))
    before, fold = time.process_time(), division.fold
    scores = np.empty((len(PLAYS), len(fold), division.classes))
    for held in range(FOLDS):
        score = way.learn(division, np.flatnonzero(fold != held))
        for scores_of_play, play in zip(scores, PLAYS.values(), strict=True):
            scores_of_play[fold == held] = score(play(division.recordings.spikes[fold == held]))
    np.save(path, scores)
    right = float((scores[0].argmax(axis=1) == division.labels).mean())
    print(
        f"{division.dataset} {name} {division.repeat}: {right:.3f} in {time.process_time() - before:.0f} s",
        flush=True,
    )
    return scores


def row_of(label: str, divisions: Sequence[Division], scores: Sequence[Floats]) -> list[str]:
    """Return a row of the table: means over all folds of the divisions, and the standard error of the first.

    Plays without scores get a dash.
    """
    plays, right = min(map(len, scores)), []
    for division, of_division in zip(divisions, scores, strict=True):
        hits = of_division[:plays].argmax(axis=2) == division.labels
        right += [hits[:, division.fold == held].mean(axis=1) for held in range(FOLDS)]
    whole, *others = np.transpose(right)
    figures = [
        whole.mean(),
        whole.std(ddof=1) / len(whole) ** 0.5,
        *(play.mean() for play in others),
    ]
    cells = [f"{figure:.3f}" for figure in figures]
    first = divisions[0]
    title = f"{first.dataset.title()}{', first division' if len(divisions) == 1 else ''}: {label}"
    return [title, str(len(whole)), *cells, *["-"] * (len(PLAYS) - plays)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/tried")
    parser.add_argument("--settings", type=Path, default=HERE / "tried_settings.yaml")
    parser.add_argument("--dataset", choices=("objects", "containers"), default="containers")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--names", nargs="*")
    parser.add_argument(
        "--table", type=Path, default=ROOT / "docs/research/results/tried-training.csv"
    )
    args = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    args.work.mkdir(parents=True, exist_ok=True)
    recordings, ways_by_name = (
        read_recordings(args.data / f"Ev-{args.dataset.title()}.zip", split="train"),
        settings_of(args.settings),
    )
    divisions = [
        Division(args.dataset, recordings, repeat, args.work, args.data, ways_by_name)
        for repeat in range(args.repeats)
    ]
    for name in args.names or list(ways_by_name):
        scores_of_divisions = [
            scores for division in divisions if (scores := scores_of(division, name)) is not None
        ]
        if len(scores_of_divisions) == len(divisions):
            row = row_of(ways_by_name[name].label, divisions, scores_of_divisions)
            print(f"{name:24} {row}", flush=True)
            write_table(args.table, merged((HEAD, [row]), read_table(args.table)))


if __name__ == "__main__":
    main()
