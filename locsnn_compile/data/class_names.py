"""Which class number belongs to which class name.

A network's output k is class k, so names and numbers must agree between recordings and the model that
takes them. Folders and labels name classes in no order of their own. This module gives them one: the
order of their numbers if they are digits or number words, the order that the user lists, or the order
of a model. Where the order of the names changes, the labels are renumbered with it.
"""

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
"""From 0 on, in the languages of the published sets of spoken digits (SHD has both, English first)."""
_PLACE_OF_WORD = {
    word: (language, number)
    for language, words in enumerate(_NUMBER_WORDS)
    for number, word in enumerate(words.split())
}
"""Number word -> (language, number): sorting by it sorts by language first, as SHD's classes are."""

SPARSE = 2
"""How far apart numbers may be to be labels. Names such as ``0, 1, 9`` are labels of classes 0 to 9
with gaps if the largest is less than this many times their count; else they are only names to sort.
Chosen by hand.
"""


def number_order(names: Collection[str]) -> list[str] | None:
    """Return names that are digits or number words in the order of their numbers; None for other names.

    A set may lack a number. If it has a ``0``, the name ``9`` is class 9 even if nothing is called
    ``8``, and the name ``8`` is then added. If it has no ``0``, or its numbers are far apart (see
    :data:`SPARSE`), the names are only sorted.
    """
    if all(_is_digits(name) for name in names):
        return _without_gaps({int(name): name for name in names}, str)
    places = {name: _PLACE_OF_WORD.get(name.lower()) for name in names}
    number_places = [place for place in places.values() if place is not None]
    if len(number_places) < len(names):
        return None
    languages = {language for language, _ in number_places}
    # Words of one language, each once, are numbered like digits. "One" and "one" would be one number,
    # and two languages are two classes per number: both are only sorted.
    if len(languages) == 1 and len(set(number_places)) == len(names):
        words = _NUMBER_WORDS[languages.pop()].split()
        numbered = {number: name for (_, number), name in zip(number_places, places, strict=True)}
        return _without_gaps(numbered, words.__getitem__)
    return sorted(places, key=lambda name: (places[name], name))


def _is_digits(name: str) -> bool:
    """Return whether a name is a number without leading zeros, which have a meaning of their own."""
    return name.isascii() and name.isdecimal() and name == str(int(name))


def _without_gaps(numbered: dict[int, str], name_of: Callable[[int], str]) -> list[str]:
    """Return names in the order of their numbers; ``name_of`` names each number that is missing from 0 on."""
    largest = max(numbered)
    if 0 not in numbered or largest >= SPARSE * len(numbered):
        return [numbered[number] for number in sorted(numbered)]
    return [numbered.get(number) or name_of(number) for number in range(largest + 1)]


def labels_of_names(
    labels: Sequence[str], class_names: tuple[str, ...] | None, where: str
) -> tuple[IntArray, tuple[str, ...]]:
    """Return (the class number of each label, the names of the classes), given labels that are names.

    Without ``class_names``, the classes are those that occur, in their known order or else sorted.
    Raises ``InputError`` for a label that is not among the class names.
    """
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
    """Return recordings whose class k is called ``names[k]``.

    If their classes have names already, the labels are renumbered to fit; if not, class k simply gets
    the name ``names[k]``. Raises ``InputError`` if a class of the recordings has a name that is not
    among ``names``.
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
    """Return recordings with labels in the numbering of a model.

    If either side has no class names, or the recordings have a class that the model lacks, they are
    returned unchanged; :meth:`.recordings.Expected.check` refuses such classes later.
    """
    own_names = recordings.class_names
    if model_names is None or own_names is None or not {*own_names} <= {*model_names}:
        return recordings
    return with_classes(recordings, tuple(model_names))


def _relabelled(recordings: Recordings, names: tuple[str, ...]) -> np.ndarray | None:
    """Return the labels of recordings in the order of ``names``; None without labels."""
    if recordings.labels is None or recordings.class_names is None:
        return recordings.labels
    new_label = np.array([names.index(name) for name in recordings.class_names], dtype=np.int64)
    return new_label[recordings.labels]
