"""What ``locsnn run`` prints about recordings, for programs of any chip: as JSON and as lines.

The fields of each class are the keys of its JSON object, in this order. A field of the type
``IfKnown`` is left out where it is None, ``INLINED`` puts the keys of an object into the object
around it, and ``LeftOut`` leaves the key out where the value is None.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from hw_model.values import IntArray
from locsnn_compile.errors import check_most
from locsnn_compile.report.figures.entries import INLINED, Entry, IfKnown, LeftOut
from locsnn_compile.report.format import plural
from locsnn_compile.verification.savings import Savings


class Change(Entry):
    """The prediction from a step on (counted from 1).

    ``lead`` is the score of the predicted class less that of the second, at this step.
    """

    step: int
    prediction: int
    lead: float


class EarlyStop(Entry):
    """The step after which a recording was stopped, and what was predicted there."""

    step: int
    prediction: int


class Outcome(Entry):
    """What a program predicted for a recording.

    ``tied``: all classes have the same score, and the program names no class for this case. Then
    ``prediction`` is the first class, but counts as wrong. ``spikes`` are all spikes of the program,
    ``changes`` those of the prediction with ``--stream``, and ``stop`` where ``--stop`` ended it.
    """

    recording: int
    prediction: int
    tied: bool
    label: int | None
    spikes: int
    changes: IfKnown[tuple[Change, ...]] = None
    stop: IfKnown[EarlyStop] = None

    @property
    def is_right(self) -> bool:
        """Whether the label is what was predicted."""
        return self.prediction == self.label and not self.tied


class CalibratedOn(Entry):
    """The recordings on which a margin was found, and how well it did there.

    ``agreement``: the share of them whose prediction at the stop is that after the last step, of
    which ``min_agreement`` was required.
    """

    source: str
    part: str | None
    recordings: int
    min_agreement: float
    agreement: float


class Margin(Entry):
    """The lead that ends a recording: how far the best score must be above the second.

    ``margin`` is None if no lead was enough for the agreement that was required. ``calibrated_on``
    is None if the user gave the margin.
    """

    margin: float | None
    calibrated_on: CalibratedOn | None


class StopFigures(Entry):
    """What stopping early saves, and how predictions compare with those of whole recordings.

    ``kind`` is the value of ``--stop``. ``accuracy`` is that at the stops and ``whole_accuracy`` that
    after the last steps; both are None without labels.
    """

    kind: str
    margin: Annotated[Margin | None, INLINED, LeftOut()]
    savings: Annotated[Savings, INLINED]
    agreement: float
    accuracy: float | None
    whole_accuracy: float | None
    recordings: int


class StepLatency(Entry):
    """Seconds that a step took on this machine: the mean, the 99th percentile and the longest."""

    mean: float
    p99: float
    worst: float


class StreamFigures(Entry):
    """The pace of a stream, and how early its predictions are right.

    ``step_seconds`` is the width of a step at the sensor, None if unknown. A real-time factor is
    that width by the time that a step took here, on average and in the longest step. ``right`` has,
    for each step, the share of recordings that predict what ``right_is`` names: the label, or the
    prediction after the last step.
    """

    psi: float | None
    step_seconds: float | None
    step_latency_seconds: StepLatency
    real_time_factor: float | None
    worst_real_time_factor: float | None
    right_is: str
    right: tuple[float, ...]


class RunFigures(Entry):
    """All that ``locsnn run --json`` prints; the energy is None for chips without published constants."""

    program: str
    recordings: tuple[Outcome, ...]
    counts: Mapping[str, int]
    energy_pj: Mapping[str, float] | None
    assumptions: tuple[str, ...]
    binning: IfKnown[Mapping[str, Any]] = None
    stream: IfKnown[StreamFigures] = None
    stop: IfKnown[StopFigures] = None


def check_classes(labels: IntArray, classes: int) -> None:
    """Refuse labels that are not among the ``classes`` of a program, counted from 0."""
    where = "labels of --events"
    fix = "Check that the recordings belong to this program."
    check_most(int(labels.max()), classes - 1, where, "no class has this number", fix=fix)


def recording_line(outcome: Outcome) -> str:
    """Return the outcome of a recording as one line."""
    label = "" if outcome.label is None else f"  label {outcome.label}"
    predicted = "all classes tie" if outcome.tied else f"class {outcome.prediction}"
    return f"recording {outcome.recording}: {predicted}{label}  {plural(outcome.spikes, 'spike')}"


class Tally(Entry):
    """How many recordings were played, how many have a label, and how many of these are right."""

    recordings: int = 0
    labelled: int = 0
    right: int = 0

    @classmethod
    def of(cls, outcomes: Sequence[Outcome]) -> "Tally":
        """Return the tally of some recordings."""
        return cls(
            recordings=len(outcomes),
            labelled=sum(outcome.label is not None for outcome in outcomes),
            right=sum(outcome.is_right for outcome in outcomes),
        )

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(
            recordings=self.recordings + other.recordings,
            labelled=self.labelled + other.labelled,
            right=self.right + other.right,
        )


def accuracy_lines(tally: Tally) -> list[str]:
    """Return a line on how many of the labelled recordings are right; none without labels."""
    if not tally.labelled:
        return []
    accuracy = tally.right / tally.labelled
    return [f"accuracy {accuracy:.3f} on {plural(tally.labelled, 'recording')}"]
