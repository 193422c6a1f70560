"""Train and test parts for recordings without folders of these names: from files of rows, or as shares of each class.

VT_SNN's preprocessed sets are a ``tact.pt`` of (samples, 78 cells, 2 polarities, steps). Next to it lie, for each of
five rounds k, ``train_80_20_<k>.txt`` and ``test_80_20_<k>.txt``, with the number and the class of one recording per
line.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.values import Frozen, IntArray
from locsnn_compile.data.archives import archive_parts
from locsnn_compile.data.member_names import PARTS
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, check_range

PREPROCESSED = "tact.pt"
_ROWS = re.compile(r"train_80_20_(\d{1,3})\.txt")


class Division(Frozen):
    """How recordings are divided: ``share`` of every class goes to the test part; ``fold`` is the round, from 1.

    Each round tests on other recordings: with a share of 0.2, every recording is tested on in one of five rounds.
    Without a share, the files next to the recordings divide them, if there are any.
    """

    share: float | None = None
    fold: int | None = None

    def divides(self, path: Path) -> bool:
        """Tell whether it divides the recordings at ``path``; ``InputError`` if they are divided already."""
        name, asked = ("fold", self.fold) if self.share is None else ("split", self.share)
        folders, rounds = path.is_dir() or path.suffix == ".zip", _rounds(path)
        parts = archive_parts(path) if asked is not None and folders else ()
        if parts or (rounds and self.share is not None):
            measured = f"into {', '.join(parts)}" if parts else "into rounds"
            raise InputError(name, f"{path.name!r} is divided already", measured=measured, fix="Leave it out.")
        return asked is not None or bool(rounds)

    def part(self, found: Recordings, path: Path, part: str) -> Recordings:
        """Return the train or test part of the recordings at ``path``; ``InputError`` if there is none."""
        rounds = range(1, int(1 / self.share + 1e-9) + 1) if self.share else _rounds(path)
        fold, at = 1 if self.fold is None else self.fold, PARTS.index(part)
        if fold not in rounds:
            measured = f"got {fold} against {', '.join(map(str, rounds)) or 'none'}"
            fix = "Choose one of them." if rounds else "Add --split with the share of every class to test on."
            raise InputError("fold", f"{path.name!r} has no such round", measured=measured, fix=fix)
        if self.share is None:
            rows, labels = _rows_of_files(path, fold, len(found))[at].T
        elif found.labels is None:
            where, what = f"recordings {found.source!r}", "they have no labels to divide them by"
            raise InputError(where, what, fix="Give labelled recordings.")
        else:
            rows = stratified_split(found.labels, self.share, 0, fold)[at]
            labels = found.labels[rows]
        how = f"round {fold} of {len(rounds)}" if self.share is None else f"split {self.share:g}, round {fold}"
        return replace(found.subset(rows), labels=labels, source=f"{path.name}, {part} part ({how})")

    def __post_init__(self) -> None:
        if self.share is not None:
            check_range(self.share, 0.001, 0.9, "split")


def stratified_split(labels: IntArray, fraction: float, seed: int, fold: int = 1) -> tuple[IntArray, IntArray]:
    """Return sorted indices (kept, held out): each class gives ``fraction`` of its recordings, rounded.

    If ``fraction`` is above 0, a class of two or more recordings gives at least one. The next ``fold`` takes the next
    recordings. Equal numbers give equal draws on every machine.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0])))
    held: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        wanted = round(fraction * len(members))
        if fraction > 0 and len(members) >= 2:
            wanted = min(max(wanted, 1), len(members) - 1)
        held.append(np.roll(rng.permutation(members), -(fold - 1) * wanted)[:wanted])
    chosen = np.sort(np.concatenate(held))
    return np.setdiff1d(np.arange(len(labels)), chosen), chosen


def _rounds(path: Path) -> list[int]:
    """Return the rounds for which there are files next to a ``tact.pt``."""
    files = path.parent.glob("train_80_20_*.txt") if path.name == PREPROCESSED else ()
    return sorted(int(match[1]) for match in (_ROWS.fullmatch(file.name) for file in files) if match)


def _rows_of_files(path: Path, fold: int, samples: int) -> list[IntArray]:
    """Return an array (rows, 2) for each part of a round: numbers of recordings, all different, and their classes."""
    fix, taken, parts = "Write the number of a recording and its class on every line.", set[int](), []
    for part in PARTS:
        file = path.with_name(f"{part}_80_20_{fold}.txt")
        where = f"file {file.name!r}"
        if not file.exists():
            raise InputError(where, "it does not exist, but the file of the other part does", fix="Give both.")
        try:
            rows = [[int(word) for word in line.split()] for line in read_bytes(file, where).splitlines()]
        except ValueError:
            rows = []
        if not rows or {len(row) for row in rows} != {2}:
            raise InputError(where, "it does not hold two whole numbers per line", fix=fix)
        for number, _ in rows:
            if number in taken or not 0 <= number < samples:
                what = "in the round twice" if number in taken else "not there"
                raise InputError(where, f"recording {str(number)[:20]} is {what}", measured=f"of {samples}", fix=fix)
            taken.add(number)
        parts.append(np.array(rows))
    return parts
