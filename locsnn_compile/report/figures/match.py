"""Entries of report.json on the match: how the program on the chip compares with the trained network.

Both sides play the same recordings. The reference is the network in float64 or, if it was trained in
integers, in these. Compared are spikes, predicted classes and class scores. ``verification/matching.py``
compares them: its :class:`Agreement` is what it finds for any kind of chip, and its :class:`Match` adds what a
mesh or the open core counted. This module turns both into the classes that become report.json.

A field that is ``INLINED`` has its keys among those of the object around it, without nesting.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from hw_model.values import Frozen
from locsnn_compile.data.recordings import Binned, Origin
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.checks import CauseFigures
from locsnn_compile.report.figures.entries import INLINED, Entry, IfKnown
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.verification.chance import Chance
from locsnn_compile.verification.matching import Agreement, Divergence, Match, PopulationMatch


class SpikesCompared(Entry):
    """How equal the spikes of both sides are.

    ``spike_agreement`` is ``2 * common / (reference + chip)``, where ``common`` counts spikes of the same neuron in the
    same step on both sides; None if neither side spikes. ``spike_mismatches`` counts the spikes of one side only.
    """

    spike_agreement: float | None
    spike_mismatches: int
    reference_spikes: int
    chip_spikes: int


class ClassScores(Entry):
    """Class scores in the network's units, as means over the recordings.

    ``mean_spread`` is how far the reference's scores lie apart, and ``mean_error`` how far the chip's are off.
    """

    mean_spread: float
    mean_error: float


class FirstDivergence(Entry):
    """The first spike that differs: its ``place``, with the potentials of both sides there, and why it differs.

    The cause is None if nothing looked for it.
    """

    place: Annotated[Divergence, INLINED]
    cause: CauseFigures | None


class ReadoutFigures(Entry):
    """What the class is predicted from: spikes or potentials of the output populations.

    ``potentials_of`` names those read by potential, and is absent unless others are read by spikes.
    ``silent``: neither side predicts anything, or none of the populations spikes.
    """

    populations: tuple[str, ...]
    by: Literal["spikes", "potentials", "spikes and potentials"]
    potentials_of: IfKnown[tuple[str, ...]]
    silent: bool

    @property
    def reads_potentials(self) -> bool:
        """Whether any population is read by its potentials."""
        return "potentials" in self.by

    def is_by_potential(self, population: str) -> bool:
        """Return whether a population is read by its potentials."""
        if self.potentials_of is not None:
            return population in self.potentials_of
        return self.by == "potentials" and population in self.populations


class MatchFigures(Entry):
    """``match``: how the program compares with the network, over all recordings of the check.

    - ``events_origin``: the kind of place that the recordings come from, such as files that the user gave;
      ``events_source`` names it in words
    - ``tied_predictions``: recordings in which all class scores of both sides tie, so nothing is predicted
    - ``score_error``: the mean error of class scores as a share of their spread
    - ``helper_neurons``: populations that a reader of model files added; they count nowhere else
    """

    reference: Literal["float64", "integers"]
    events_origin: Origin
    samples: int
    events_source: str
    prediction_agreement: float | None
    spikes: Annotated[SpikesCompared, INLINED]
    tied_predictions: int
    score_error: float | None
    class_scores: ClassScores
    by_population: Mapping[str, SpikesCompared]
    helper_neurons: Mapping[str, SpikesCompared]
    first_divergence: FirstDivergence | None
    wraps: int
    clips: int
    wraps_and_clips_by_population: Mapping[str, Mapping[str, int]]
    readout: ReadoutFigures


class Accuracy(Entry):
    """The share of correct predictions of both sides."""

    reference: float
    chip: float


class ChanceFigures(Entry):
    """The test of the accuracy against guessing the commonest label; ``told_apart``: they differ significantly."""

    test: Annotated[Chance, INLINED]
    told_apart: bool


class BinningFigures(Entry):
    """What became of the events in files when they were sorted into bins, one per channel and step.

    Of ``events``, ``outside`` lay outside the steps, ``below`` in bins with at most ``threshold`` events,
    which are 0, and ``elsewhere`` in streams that are not read; ``dropped`` is the sum, and ``words`` says it.
    ``threshold`` is None if the files already held bins.
    """

    threshold: int | None
    events: int
    outside: int
    below: int
    elsewhere: int
    dropped: int
    words: str


class InputFigures(Entry):
    """How many steps recordings have before their first event, if a phase of the network begins at that event.

    Means over the recordings: of the phase that waits longest, and of every phase, 0 for those that do not wait. A
    branch is a phase of the program here. Without a phase that waits, ``aligned_steps_by_branch`` is empty.
    """

    aligned_steps: float
    aligned_steps_by_branch: Mapping[str, float]


class Overflows(Frozen):
    """How often numbers on the chip did not fit their registers, over all recordings of the check.

    ``wraps`` went on at the other end of the register, and ``clips`` stopped at its end. ``events`` counts
    them by place, such as a population or a phase, under the names that the chip has for them.
    """

    wraps: int
    clips: int
    events: Mapping[str, Mapping[str, int]]


def match_figures(
    network: Network,
    match: Agreement,
    grounds: Grounds,
    overflows: Overflows,
    cause: CauseFigures | None = None,
) -> MatchFigures:
    """Return how the program compares with the network; ``cause`` explains the first spike that differs."""
    first = match.first_divergence
    return MatchFigures(
        reference="float64" if network.has_float_weights else "integers",
        events_origin=grounds.events_origin,
        samples=match.samples,
        events_source=match.events_source,
        prediction_agreement=match.prediction_agreement,
        spikes=spikes_compared(match.spikes),
        tied_predictions=match.tied_predictions,
        score_error=match.scores.relative_error,
        class_scores=ClassScores(match.scores.mean_spread, match.scores.mean_error),
        by_population={
            name: spikes_compared(spikes) for name, spikes in match.by_population.items()
        },
        helper_neurons={name: spikes_compared(spikes) for name, spikes in match.helpers.items()},
        first_divergence=None if first is None else FirstDivergence(first, cause),
        wraps=overflows.wraps,
        clips=overflows.clips,
        wraps_and_clips_by_population=overflows.events,
        readout=_readout(network, match),
    )


def spikes_compared(spikes: PopulationMatch) -> SpikesCompared:
    """Return how equal the spikes of both sides are."""
    return SpikesCompared(
        spike_agreement=spikes.agreement,
        spike_mismatches=spikes.mismatches,
        reference_spikes=spikes.reference_spikes,
        chip_spikes=spikes.chip_spikes,
    )


def _readout(network: Network, match: Agreement) -> ReadoutFigures:
    populations = tuple(network.readout.populations)
    # ``from_step`` has the populations that are read by their potentials, in the order of ``populations``, each with
    # the first step that counts.
    by_potential = tuple(network.readout.from_step)
    if not by_potential:
        # The agreement of spikes is None where neither side spikes.
        spiked = any(match.by_population[name].agreement is not None for name in populations)
        return ReadoutFigures(populations, "spikes", potentials_of=None, silent=not spiked)
    # Potentials may decide without any spike, so only ties in all recordings show that nothing was predicted.
    silent = match.tied_predictions == match.samples
    if by_potential == populations:
        return ReadoutFigures(populations, "potentials", potentials_of=None, silent=silent)
    return ReadoutFigures(populations, "spikes and potentials", by_potential, silent)


def accuracy_figures(accuracy: Mapping[str, float] | None) -> Accuracy | None:
    """Return the accuracy of both sides; None without labels."""
    return None if accuracy is None else Accuracy(**accuracy)


def chance_figures(chance: Chance | None) -> ChanceFigures | None:
    """Return the test of the accuracy against chance; None where there are too few labels."""
    return None if chance is None else ChanceFigures(chance, chance.told_apart)


def binning_figures(binned: Binned | None) -> BinningFigures | None:
    """Return what became of events in files; None if the recordings were not read from events."""
    if binned is None:
        return None
    return BinningFigures(
        threshold=binned.threshold,
        events=binned.events,
        outside=binned.outside,
        below=binned.below,
        elsewhere=binned.elsewhere,
        dropped=binned.dropped,
        words=binned.words,
    )


def input_figures(network: Network, match: Match) -> InputFigures:
    """Return the mean steps before the first event of recordings; 0 for a network that does not wait for it."""
    has_aligned_views = any(view.align_events for view in network.views)
    steps_by_phase = {}
    if has_aligned_views:
        steps_by_phase = {
            name: counts.aligned_steps / match.samples
            for name, counts in match.counts_by_phase.items()
        }
    return InputFigures(max(steps_by_phase.values(), default=0.0), steps_by_phase)
