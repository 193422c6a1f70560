"""Recordings as every part of the project takes them: binned spikes, labels, and the width of a bin.

:class:`Recordings` is what readers return, whatever the format of the file. :class:`Expected` is what a
model or a program expects of recordings; readers check options and files against it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np

from hw_model.io.records import Must
from hw_model.mapping.recorded import RecordedChannels
from hw_model.values import AnyArray, ByteArray, Frozen, IntArray, Shown, picked, sealed
from locsnn_compile.data.channels import Channels, Numbering
from locsnn_compile.errors import InputError, check_same, counted

#: Largest set of recordings accepted, in array elements: four times the largest published tactile set.
MAX_ELEMENTS = 200_000_000
#: Most time steps of a recording, unless more are allowed: a few times what any published tactile recording needs.
MAX_STEPS = 20_000
#: Most time steps that can be allowed.
MOST_STEPS = 1_000_000
#: Largest class number accepted.
MAX_LABEL = 100_000
#: Most characters of a class's name.
MAX_NAME = 80
STEP_SECONDS = Must(lambda v: (v > 0) & (v <= 1e6), "above 0 and at most 1e+06")
"""The condition on the width of a bin, in seconds, and its words in errors."""

Origin = Literal["given", "carried", "trained on", "made up"]
"""Where recordings come from: files or arrays of the user (``given``), a few that a checkpoint carries
(``carried``), some of a checkpoint's own training recordings (``trained on``), or
``locsnn_compile.data.synthetic`` (``made up``).
"""


class Binned(Frozen):
    """What became of the events in files when they were put into bins.

    - ``events``: how many there were in all
    - ``outside``: how many lay before the first step or after the last
    - ``below``: how many lay in bins with at most ``threshold`` events; such bins are 0
    - ``elsewhere``: how many were not read, because they lay in further streams of their files or before the first time
    - ``step_is_default``: whether the width of a bin is the default, because no file, option or model states one

    If the files hold bins, ``threshold`` is None, ``events`` counts the bins that are 1, and ``outside`` counts those
    of them that were cut off.
    """

    threshold: int | None
    events: int
    outside: int
    below: int
    elsewhere: int = 0
    step_is_default: bool = field(default=False, compare=False)

    @property
    def dropped(self) -> int:
        """Events that are not in any bin."""
        return self.outside + self.below + self.elsewhere

    @property
    def words(self) -> str:
        """How many events are lost, and why."""
        reasons = [f"{self.outside} outside the steps"]
        if self.threshold is not None:
            reasons.append(f"{self.below} in bins of at most {self.threshold}")
        if self.elsewhere:
            reasons.append(f"{self.elsewhere} in further streams or before the first time")
        return f"{self.dropped} of {counted(self.events, 'event')} dropped: {', '.join(reasons)}"

    def document(self) -> dict[str, int | None]:
        """Return the figures as plain values, for JSON."""
        counts = picked(self, "threshold", "events", "outside", "below", "elsewhere")
        return {**counts, "dropped": self.dropped}


class Recordings(Shown):
    """Recordings in bins, their labels, and where they come from. The arrays are read-only.

    - ``spikes``: uint8 (samples, steps, channels), 0 or 1; ``labels``: int64 (samples,), class numbers from 0, or None
    - ``step_seconds``: width of a time bin, None if unknown
    - ``source``: name of the file, without folders; ``origin``: where the recordings come from
    - ``binned``: what reading left out, None if it left out nothing
    - ``first``: the number of the first recording in its file, if these are a chunk of a file; only errors use it
    - ``class_names``: from class 0 on, if the classes have names
    - ``channels``: the pixels that the channels are, None if nothing says so
    - ``assumed``: the assumptions made where nothing stated a fact, as sentences for the user
    - ``recorded``: the sensor, if the channels are only some of its channels, or several merged into one

    Raises ``InputError`` for anything else.
    """

    spikes: ByteArray
    labels: IntArray | None
    step_seconds: float | None
    source: str
    origin: Origin = "given"
    binned: Binned | None = None
    first: int = 0
    class_names: tuple[str, ...] | None = None
    channels: Channels | None = None
    assumed: tuple[str, ...] = ()
    recorded: RecordedChannels | None = None

    def __post_init__(self) -> None:
        where = f"recordings {self.source!r}"
        object.__setattr__(self, "spikes", clean_spikes(where, np.asarray(self.spikes), self.first))
        if self.labels is not None:
            object.__setattr__(
                self, "labels", _clean_labels(where, np.asarray(self.labels), len(self.spikes))
            )
        if self.class_names is not None:
            # Every label needs a name; there may be names of classes that do not occur.
            least = 0 if self.labels is None else int(self.labels.max(initial=-1)) + 1
            object.__setattr__(
                self, "class_names", clean_class_names(where, self.class_names, least)
            )
        seconds = self.step_seconds
        if seconds is not None and not STEP_SECONDS.holds(seconds):
            fix = "Give the width of a bin."
            raise InputError(
                where,
                f"step_seconds must be {STEP_SECONDS.words}",
                measured=f"got {seconds!r}",
                fix=fix,
            )

    def __len__(self) -> int:
        return len(self.spikes)

    def assuming(self, sentence: str) -> "Recordings":
        """Return the same recordings with one more assumption, unless they have the sentence already."""
        if sentence in self.assumed:
            return self
        return replace(self, assumed=(*self.assumed, sentence))

    def called(self, label: int) -> str:
        """Return ``label 1``, or ``label 1 (slide)`` where the class has a name."""
        names = self.class_names or ()
        return f"label {label} ({names[label]})" if label < len(names) else f"label {label}"

    def needed_labels(self, purpose: str) -> IntArray:
        """Return the labels; ``InputError`` if there are none.

        ``purpose`` ends the error's sentence "they have no labels to ...".
        """
        if self.labels is None:
            what, fix = f"they have no labels to {purpose}", "Give labelled recordings."
            raise InputError(f"recordings {self.source!r}", what, fix=fix)
        return self.labels

    @property
    def threshold(self) -> int | None:
        """The number of events that a bin has to exceed to become 1; None if the files hold bins."""
        return None if self.binned is None else self.binned.threshold

    def with_steps(self, steps: int) -> "Recordings":
        """Return recordings of ``steps`` steps: shorter ones are padded with silence, longer ones are cut."""
        samples, old_steps, channels = self.spikes.shape
        if steps == old_steps:
            return self
        lost = int(self.spikes[:, steps:].sum())
        spikes = np.zeros((samples, steps, channels), dtype=np.uint8)
        spikes[:, : min(steps, old_steps)] = self.spikes[:, :steps]
        before = self.binned or Binned(
            threshold=None, events=int(self.spikes.sum()), outside=0, below=0
        )
        binned = replace(before, outside=before.outside + lost) if lost else self.binned
        return replace(self, spikes=spikes, binned=binned)

    def subset(self, indices: IntArray | list[int]) -> "Recordings":
        """Return the recordings of ``indices``, in that order."""
        rows = np.asarray(indices, dtype=np.int64)
        labels = None if self.labels is None else self.labels[rows]
        return replace(self, spikes=self.spikes[rows], labels=labels)


def check_size(samples: int, steps: int, channels: int, where: str) -> None:
    """Refuse recordings of more than :data:`MAX_ELEMENTS` values; the ``InputError`` says how many fit."""
    values = samples * steps * channels
    if values <= MAX_ELEMENTS:
        return
    what = f"its recordings of {samples} x {steps} x {channels} are too large"
    measured = f"{values} values against {MAX_ELEMENTS}"
    raise InputError(where, what, measured=measured, fix=fewer_recordings(steps * channels))


def fewer_recordings(values_of_one: int) -> str:
    """Return the fix that an error suggests for too many recordings: how many fit, given the values of one."""
    fit = MAX_ELEMENTS // values_of_one
    if fit == 0:
        return "Give wider bins, or shorter recordings."
    return f"Give at most {fit} at a time and average the figures of the parts, or give wider bins."


def clean_spikes(where: str, spikes: AnyArray, first: int = 0) -> ByteArray:
    """Return spikes (samples, steps, channels) as read-only uint8; ``InputError`` for anything else.

    ``first`` is the number of the first sample in error messages.
    """
    fix = "Give binned recordings of zeros and ones."
    check_same(
        spikes.ndim,
        3,
        where,
        "its number of axes is wrong",
        fix="Give an array (samples, steps, channels).",
    )
    if 0 in spikes.shape:
        raise InputError(where, "no recordings inside", measured=f"shape {spikes.shape}", fix=fix)
    samples, steps, channels = spikes.shape
    check_size(samples, steps, channels, where)
    if spikes.dtype.kind not in "biuf":
        raise InputError(
            where, "its values are not numbers", measured=f"dtype {spikes.dtype}", fix=fix
        )
    wrong = ~((spikes == 0) | (spikes == 1))
    if wrong.any():
        sample, step, channel = (int(i[0]) for i in np.nonzero(wrong))
        measured = f"{spikes[sample, step, channel]} at sample {first + sample}, channel {channel}, step {step}"
        way_out = (
            "Give binned recordings of zeros and ones; numbers go to layers on the host "
            "(locsnn-compile --host-layers)."
        )
        raise InputError(where, "its values are not all 0 or 1", measured=measured, fix=way_out)
    return sealed(np.array(spikes, dtype=np.uint8, order="C"))


def clean_class_names(where: str, names: Sequence[object], least: int) -> tuple[str, ...]:
    """Return the names of classes, which must be all different, printable, and at least ``least`` in number.

    Raises ``InputError`` for others.
    """
    odd = [
        name
        for name in names
        if not (isinstance(name, str) and 0 < len(name) <= MAX_NAME and name.isprintable())
    ]
    fix = f"Give a name of 1 to {MAX_NAME} printable characters for each class, from class 0 on."
    if odd:
        raise InputError(
            where, "a class name cannot be used", measured=f"{odd[0]!r}"[: MAX_NAME + 2], fix=fix
        )
    if (many := len(set(names))) != len(names) or not least <= len(names) <= MAX_LABEL:
        measured = f"{many} different ones against {max(least, len(names))}"
        raise InputError(
            where, "its class names do not fit its classes", measured=measured, fix=fix
        )
    return tuple(map(str, names))


def _clean_labels(where: str, labels: AnyArray, samples: int) -> IntArray:
    """Return labels as read-only int64, (samples,); ``InputError`` if they are not one class number per recording."""
    fix = "Give one class number from 0 up per recording."
    check_same(labels.shape, (samples,), where, "labels and recordings differ in number", fix=fix)
    values = labels.astype(np.float64) if labels.dtype.kind in "iuf" else np.full(samples, np.nan)
    # Written so that NaN is refused as well.
    wrong = ~((values == np.floor(values)) & (values >= 0) & (values <= MAX_LABEL))
    if wrong.any():
        measured = f"{str(labels[wrong][0])[:40]} of recording {int(wrong.argmax())} against 0..{MAX_LABEL}"
        raise InputError(where, "its labels are not class numbers", measured=measured, fix=fix)
    return sealed(labels.astype(np.int64))


class EventTimes(Frozen):
    """How the events that a model was trained on were timed, as far as options of the training said it.

    - ``start``: the seconds at which step 0 begins, or ``first`` (at the first event of each recording)
    - ``time_unit``: ns, us, ms or s

    None: as the format of the events has it.
    """

    start: float | str | None = None
    time_unit: str | None = None


class Expected(Frozen):
    """What a model or a program expects of recordings; None means that it does not say.

    - ``whose``: its kind and name, as errors show them: ``model 'slip'``
    - ``step_seconds``: width of a bin, which recordings must have
    - ``usual_step_seconds``: width of a bin that is used if nothing else states one
    - ``threshold``: a bin with more events than this is 1
    - ``steps``: length of a recording, None if any length will do; ``channels``: their number
    - ``inputs``: the pixels that its channels are; ``numbering``: how they are numbered, if only that is known
    - ``class_names``: the names of its classes, from class 0 on
    - ``event_times``: how events are timed if neither an option nor their format says it
    - ``recorded``: the sensor that it was trained on, if its channels are only some of the sensor's, or merged
    """

    whose: str
    step_seconds: float | None = None
    threshold: int | None = None
    steps: int | None = None
    channels: int | None = None
    class_names: tuple[str, ...] | None = None
    inputs: Channels | None = None
    numbering: Numbering | None = None
    usual_step_seconds: float | None = None
    event_times: EventTimes = EventTimes()
    recorded: RecordedChannels | None = None

    @property
    def kind(self) -> str:
        """``model`` or ``program``: ``whose`` without an article and the quoted name."""
        return self.whose.partition(" '")[0].removeprefix("the ")

    def agreed(self, **options: float | None) -> dict[str, Any]:
        """Return the value of each option, or the model's where the option is None.

        The names of the options are names of fields. Raises ``InputError`` if an option and the model differ.
        """
        for name, value in options.items():
            expected = getattr(self, name)
            if (
                value is not None
                and expected is not None
                and not same_within_rounding(value, expected)
            ):
                raise InputError(
                    name,
                    f"{self.whose} has another",
                    measured=f"got {value:g} against {expected:g}",
                    fix="Leave it out.",
                )
        return {
            name: getattr(self, name) if value is None else value for name, value in options.items()
        }

    def check(self, recordings: Recordings) -> None:
        """Refuse recordings whose classes have other names than the model's, or whose bins have another width.

        The width is only compared if the model takes recordings of one length. A network that takes any length only
        sees steps, and its user decides how long a step is. Facts that only one side knows are not compared.
        """
        names = recordings.class_names
        if self.class_names is not None and names is not None and names != self.class_names:
            what = f"their classes have other names than those of {self.whose}"
            measured = f"{', '.join(names)[:80]} against {', '.join(self.class_names)[:80]}"
            fix = "Give recordings of the same classes, in the same order."
            raise InputError(f"recordings {recordings.source!r}", what, measured=measured, fix=fix)
        expected = self.step_seconds
        width = recordings.step_seconds
        takes_any_length = self.steps is None
        if (
            takes_any_length
            or expected is None
            or width is None
            or same_within_rounding(expected, width)
        ):
            return
        raise InputError(
            f"recordings {recordings.source!r}",
            f"their steps are not as long as those of {self.whose}",
            measured=f"{width:g} s against {expected:g} s",
            fix="Give recordings that were binned for it, or their single events.",
        )


OPEN = Expected("no model")
"""Expects nothing."""


BATCH = 16
"""How many recordings are simulated together, so that the memory for their results does not grow with their number."""


def batches(samples: int) -> Iterator[slice]:
    """Yield slices of at most :data:`BATCH` that together cover ``samples`` recordings."""
    for start in range(0, samples, BATCH):
        yield slice(start, min(start + BATCH, samples))


def same_within_rounding(a: float, b: float) -> bool:
    """Return whether two numbers are equal up to the rounding of floats, also if one was stored in single precision."""
    return math.isclose(a, b, rel_tol=1e-7)
