"""Recordings of real numbers, in .npy and .npz files or as arrays.

A chip takes spikes. Real numbers go to the first layers of a network if these run on the host, and to the encoders
(:mod:`.encoders`), which turn them into spikes.
"""

import math
from pathlib import Path

import numpy as np

from hw_model.io.files import near, read_bytes
from hw_model.values import AnyArray, ArrayLike, FloatArray, IntArray, Shown
from locsnn_compile.data.array_files import BESIDE
from locsnn_compile.data.arrays import labels_beside
from locsnn_compile.data.format_rows import ArrayFile
from locsnn_compile.data.formats import array_format
from locsnn_compile.data.recordings import check_size
from locsnn_compile.errors import InputError, counted

SUFFIXES = (".npy", ".npz")


class RealValues(Shown):
    """Numbers, as a file holds them.

    - ``values``: float64 (samples, ...); ``labels``: class numbers (samples,), or None
    - ``step_seconds``: width of a step, None if unknown; ``source``: name of the file, without folders
    """

    values: FloatArray
    labels: IntArray | None = None
    step_seconds: float | None = None
    source: str = "array"

    @property
    def where(self) -> str:
        """How errors name them."""
        return f"values {self.source!r}"

    def steps_of(self, shape: tuple[int, ...], steps: int | None) -> FloatArray:
        """Return the numbers as (samples, steps, channels), given the ``shape`` of a network's input in one step.

        Arrays are (samples, steps, *shape), or (samples, *shape), which is then repeated for ``steps`` steps. In both,
        the axes of the shape may be flattened into one. Raises ``InputError`` for other arrays, and for one that is to
        be repeated if ``steps`` is None.
        """
        channels = math.prod(shape)
        samples, *axes_of_sample = self.values.shape
        inner = tuple(axes_of_sample)
        if inner in (shape, (channels,)):
            if steps is None:
                what = "the numbers do not change, and nothing says for how many steps they last"
                fix = "Give --steps, or repeat them along an axis of steps."
                raise InputError(self.where, what, fix=fix)
            check_size(samples, steps, channels, self.where)
            one_step = self.values.reshape(samples, 1, channels)
            return np.broadcast_to(one_step, (samples, steps, channels))
        if inner[1:] not in (shape, (channels,)):
            measured = f"{self.values.shape} for steps of {shape}"
            fix = "Give (samples, steps, channels), or (samples, channels)."
            raise InputError(
                self.where, "its axes do not fit the input", measured=measured, fix=fix
            )
        check_size(samples, inner[0], channels, self.where)
        return self.values.reshape(samples, inner[0], channels)


def real_values(array: ArrayLike, labels: ArrayLike | None = None) -> RealValues:
    """Return the numbers of an array (samples, ...); ``InputError`` for what is not made of numbers."""
    unlabelled = RealValues(_numbers(np.asarray(array), "values 'array'"))
    return _labelled(unlabelled, None if labels is None else np.asarray(labels))


def read_real_values(path: Path | str) -> RealValues:
    """Return the numbers in a ``.npy`` or ``.npz`` file; ``InputError`` for other files.

    A ``.npz`` file has one array, or one called ``values``, next to ``labels`` and ``step_seconds``; a
    ``.npy`` file may have ``<stem>_labels.npy`` next to it.
    """
    path = Path(path)
    where = f"values {path.name!r}"
    if path.suffix not in SUFFIXES:
        what = "numbers are read from arrays"
        measured = f"ending {path.suffix!r}"
        raise InputError(where, what, measured=measured, fix="Give a .npy or .npz file.")
    if not path.exists():
        raise InputError(where, "it does not exist", fix=near(path, "Check the path."))
    entries = array_format(path.suffix).read(ArrayFile(read_bytes(path, where), where)).entries
    names = [name for name in entries if name not in BESIDE]
    if "values" in names:
        names = ["values"]
    if len(names) != 1:
        measured = f"entries: {', '.join(sorted(entries)) or 'none'}"[:200]
        what = "it is not clear which entry holds the numbers"
        raise InputError(where, what, measured=measured, fix="Name the entry 'values'.")
    values = _numbers(entries[names[0]], where)
    seconds = entries.get("step_seconds")
    step_seconds = None if seconds is None else float(seconds.reshape(-1)[0])
    unlabelled = RealValues(values, labels=None, step_seconds=step_seconds, source=path.name)
    return _labelled(unlabelled, entries.get("labels", labels_beside(path, len(values))))


def _labelled(unlabelled: RealValues, labels: AnyArray | None) -> RealValues:
    """Return the numbers with class numbers; ``InputError`` unless there is a whole one per sample."""
    if labels is None:
        return unlabelled
    if labels.shape != unlabelled.values.shape[:1] or labels.dtype.kind not in "iu":
        measured = f"{labels.dtype} of shape {labels.shape}"
        fix = f"Give {counted(len(unlabelled.values), 'class number')}."
        raise InputError(unlabelled.where, "its labels do not fit", measured=measured, fix=fix)
    return RealValues(
        unlabelled.values, labels.astype(np.int64), unlabelled.step_seconds, unlabelled.source
    )


def _numbers(array: AnyArray, where: str) -> FloatArray:
    """Return an array of real numbers as float64; ``InputError`` for other types, and for what is not finite."""
    if array.dtype.kind not in "biuf" or array.ndim < 2 or array.size == 0:
        measured = f"{array.dtype} of shape {array.shape}"
        fix = "Give (samples, steps, channels), or (samples, channels)."
        raise InputError(where, "it is not an array of real numbers", measured=measured, fix=fix)
    values = array.astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError(where, "a number is not finite", fix="Give finite numbers.")
    return values
