"""The order of class names: a known one, one that is given, or that of a model; labels follow the names."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from hw_model.values import IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError

_NUMBER_WORDS = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen twenty",
    "null eins zwei drei vier fünf sechs sieben acht neun zehn elf zwölf",
)
"""From 0 on, in the languages of spoken digits that are published (SHD has both, English first)."""
_PLACE_OF_WORD = {
    word: (language, number)
    for language, words in enumerate(_NUMBER_WORDS)
    for number, word in enumerate(words.split())
}


SPARSE = 2
"""Numbers counted from 0 are labels if more than one in so many of them occurs as a name."""


def number_order(names: Collection[str]) -> list[str] | None:
    """Return names that are digits or number words in the order of the numbers; None for other names.

    A set may lack a number: where there is a ``0``, what is called ``9`` is class 9 even if nothing is
    called ``8``, whose name is then put in. Without a ``0``, and of numbers far apart, names are only
    sorted.
    """
    if all(_is_digits(name) for name in names):
        return _without_gaps({int(name): name for name in names}, str)
    places = {name: _PLACE_OF_WORD.get(name.lower()) for name in names}
    known = [place for place in places.values() if place is not None]
    if len(known) < len(names):
        return None
    languages = {language for language, _ in known}
    if len(languages) == 1 and len(set(known)) == len(names):
        words = _NUMBER_WORDS[languages.pop()].split()
        numbered = {number: name for (_, number), name in zip(known, places, strict=True)}
        return _without_gaps(numbered, words.__getitem__)
    return sorted(places, key=lambda name: (places[name], name))


def _is_digits(name: str) -> bool:
    return name.isascii() and name.isdecimal() and name == str(int(name))


def _without_gaps(numbered: dict[int, str], name_of: Callable[[int], str]) -> list[str]:
    """Return names in the order of their numbers, with a name for each number that is missing from 0 on."""
    largest = max(numbered)
    if 0 not in numbered or largest >= SPARSE * len(numbered):
        return [numbered[number] for number in sorted(numbered)]
    return [numbered.get(number) or name_of(number) for number in range(largest + 1)]


def labels_of_names(
    labels: Sequence[str], class_names: tuple[str, ...] | None, where: str
) -> tuple[IntArray, tuple[str, ...]]:
    """Return the class numbers of labels that are names, and the names; ``InputError`` for one that is not a class."""
    names = class_names
    if names is None:
        occurring = sorted({*labels})
        names = tuple(number_order(occurring) or occurring)
    for label in labels:
        if label not in names:
            measured = f"{label[:40]!r} against {', '.join(names)[:80]}"
            what = "a label is not among its class names"
            raise InputError(where, what, measured=measured, fix="Name all classes.")
    return np.array([names.index(label) for label in labels], dtype=np.int64), names


def parse_classes(text: str) -> tuple[str, ...]:
    """Return the names in a text such as ``egg,cup,ball``; ``InputError`` for empty and repeated ones."""
    names = tuple(name.strip() for name in text.split(","))
    fix = "Name each class once, from class 0 on."
    if "" in names:
        raise InputError("classes", "a class has no name", measured=f"got {text[:60]!r}", fix=fix)
    for name in names:
        if names.count(name) > 1:
            raise InputError("classes", "a class is named twice", measured=name[:60], fix=fix)
    return names


def with_classes(recordings: Recordings, names: tuple[str, ...]) -> Recordings:
    """Return recordings whose class k is called ``names[k]``; labels without names get these.

    Raises ``InputError`` if a class of the recordings has another name.
    """
    own_names = recordings.class_names
    if own_names is None:
        return replace(recordings, class_names=names)
    unknown = [name for name in own_names if name not in names]
    if unknown:
        what = f"recordings {recordings.source!r} have other classes"
        measured = f"{', '.join(unknown)[:80]} against {', '.join(names)[:80]}"
        raise InputError("classes", what, measured=measured, fix="Name all of them.")
    return replace(recordings, labels=_relabelled(recordings, names), class_names=names)


def in_order_of(recordings: Recordings, model_names: Sequence[str] | None) -> Recordings:
    """Return recordings with the labels of a model, if the names of their classes are among those of its classes."""
    own_names = recordings.class_names
    if model_names is None or own_names is None or not {*own_names} <= {*model_names}:
        return recordings
    return with_classes(recordings, tuple(model_names))


def _relabelled(recordings: Recordings, names: tuple[str, ...]) -> np.ndarray | None:
    if recordings.labels is None or recordings.class_names is None:
        return recordings.labels
    new_label = np.array([names.index(name) for name in recordings.class_names], dtype=np.int64)
    return new_label[recordings.labels]
