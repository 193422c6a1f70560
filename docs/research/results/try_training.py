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
from tables import kept, merged, write_table
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
"""How recordings that were held out are played."""
HEAD = ["training", "parts", "accuracy", "standard error", *list(PLAYS)[1:]]


def scores_of(of: Division, name: str) -> Floats | None:
    """Return the log-probabilities (plays, samples, classes) of each recording when it was held out.

    Those that were made before there were so many plays hold the first of them. None for a committee whose members have none.
    """
    way, path = of.known[name], of.work / f"{of.dataset}-{name}-{of.repeat}.npy"
    if isinstance(way, Committee):
        paths = [of.work / f"{of.dataset}-{member}-{of.repeat}.npy" for member in way.members]
        if not all(found.exists() for found in paths):
            return None
        each = [
            weight * np.load(found)
            for weight, found in zip(way.members.values(), paths, strict=True)
        ]
        return np.asarray(sum(scores[: min(map(len, each))] for scores in each))
    if path.exists():
        return np.asarray(np.load(path))
    before, fold = time.process_time(), of.fold
    scores = np.empty((len(PLAYS), len(fold), of.classes))
    for held in range(FOLDS):
        score = way.learn(of, np.flatnonzero(fold != held))
        for played, play in zip(scores, PLAYS.values(), strict=True):
            played[fold == held] = score(play(of.recordings.spikes[fold == held]))
    np.save(path, scores)
    right = float((scores[0].argmax(axis=1) == of.labels).mean())
    print(
        f"{of.dataset} {name} {of.repeat}: {right:.3f} in {time.process_time() - before:.0f} s",
        flush=True,
    )
    return scores


def row_of(label: str, divisions: Sequence[Division], scores: Sequence[Floats]) -> list[str]:
    """Return a row of the table: means over all folds of the divisions, and the standard error of that of whole recordings."""
    plays, right = min(map(len, scores)), []
    for of, found in zip(divisions, scores, strict=True):
        hits = found[:plays].argmax(axis=2) == of.labels
        right += [hits[:, of.fold == held].mean(axis=1) for held in range(FOLDS)]
    whole, *others = np.transpose(right)
    figures = [
        whole.mean(),
        whole.std(ddof=1) / len(whole) ** 0.5,
        *(play.mean() for play in others),
    ]
    known = [f"{figure:.3f}" for figure in figures]
    first = divisions[0]
    title = f"{first.dataset.title()}{', first division' if len(divisions) == 1 else ''}: {label}"
    return [title, str(len(whole)), *known, *["-"] * (len(PLAYS) - plays)]


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
    recordings, known = (
        read_recordings(args.data / f"Ev-{args.dataset.title()}.zip", split="train"),
        settings_of(args.settings),
    )
    divisions = [
        Division(args.dataset, recordings, repeat, args.work, args.data, known)
        for repeat in range(args.repeats)
    ]
    for name in args.names or list(known):
        found = [scores for of in divisions if (scores := scores_of(of, name)) is not None]
        if len(found) == len(divisions):
            row = row_of(known[name].label, divisions, found)
            print(f"{name:24} {row}", flush=True)
            write_table(args.table, merged((HEAD, [row]), kept(args.table)))


if __name__ == "__main__":
    main()
