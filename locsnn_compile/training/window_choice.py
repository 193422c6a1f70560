"""Choose the windows of a window network by cross-validation on the training recordings.

A *window* is a range of consecutive time steps in which hidden neurons count the events of a channel; its *levels* are
the numbers of events that are told apart, a neuron for each (see
:class:`locsnn_compile.models.graph_and_windows.WindowParameters`). A candidate is a length of windows with a set of
levels. Every candidate is judged on folds of the training recordings with the output weights that ``optimizer:
prototypes`` would compute (:mod:`locsnn_compile.training.prototypes`).

The scores depend on the hidden spikes only through inner products of recordings, so the cost of a candidate is that of
a matrix of recordings by recordings, however many hidden neurons it has. With G = H H^T of the hidden spikes H
(recordings, hidden), M the (recordings, classes) matrix of which a column averages over a class, and C = I - M onehot^T
that subtracts the mean of its class from every recording:

    scores = G B,  less half of what each prototype scores on itself        B = M - C^T (C G C^T + ridge I)^-1 C G M
"""

from collections.abc import Callable, Sequence

import numpy as np

from hw_model.values import (
    AnyArray,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    Frozen,
    IntArray,
)
from locsnn_compile.models.graph_and_windows import (
    AXONS_OF_CORE,
    MAX_WINDOW_NEURONS,
    WindowParameters,
)

FOLDS = 5
"""Parts into which recordings are divided; each is scored by prototypes of the others."""
SMOOTHINGS = (0.02, 0.1, 0.5, 2.0)
"""Smoothings tried; see :func:`locsnn_compile.training.prototypes.set_prototypes`."""
MOST_RECORDINGS = 600
"""Most recordings that are used, evenly from all classes: with more, the ranking of the candidates hardly changes."""
MOST_LEVELS = 8
"""Levels of the largest candidate set."""
MOST_VALUES = 50_000_000
"""Largest number of hidden spikes of a candidate: 200 MB in float32."""
TOLERANCE = 1.0
"""Accuracies count as equal within this number of standard errors of the best; then margins decide."""
MARGIN_KEPT = 0.9
"""Margins count as equal from this share of the widest on; then the fewest hidden neurons win. Chosen by hand."""
_DRAW_ROWS = 3
_DRAW_FOLDS = 4
"""The purposes of random draws, which go into their seeds so that they differ from all other draws of a run."""


class Judgement(Frozen):
    """The result of one candidate in cross-validation, with the best of :data:`SMOOTHINGS`.

    - ``hidden``: the number of its hidden neurons
    - ``accuracy``: the mean of the accuracies of the classes
    - ``margin``: the score of the right class minus the best of the other scores, on average over recordings, in
      standard deviations over recordings. It ranks candidates that are all right about every recording.
    """

    windows: WindowParameters
    smoothing: float
    hidden: int
    accuracy: float
    margin: float


class WindowChoice(Frozen):
    """The chosen windows and smoothing, and on what the choice is based.

    ``accuracy`` is that of cross-validation, the mean over classes; ``candidates``, ``folds`` and ``recordings`` are
    numbers.
    """

    windows: WindowParameters
    smoothing: float
    accuracy: float
    candidates: int
    folds: int
    recordings: int


def choose_windows(
    spikes: ByteArray,
    labels: IntArray,
    polarities: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> WindowChoice | None:
    """Return the choice for recordings (samples, steps, channels); None if it cannot be made.

    That is so if fewer than two classes have two recordings, or if all candidates are too large. ``polarities``: those
    of a taxel, whose channels share an output. ``progress`` is called with (candidates judged, candidates to judge).
    """
    rows = balanced_rows(labels, MOST_RECORDINGS, seed)
    looked_at = spikes[rows]
    # Classes are renumbered without gaps.
    _, classes = np.unique(labels[rows], return_inverse=True)
    folds = fold_numbers(classes, seed)
    if folds is None:
        return None
    candidates = candidate_windows(looked_at, polarities)
    judged: list[Judgement] = []
    for windows in candidates:
        judged.append(judge(window_spikes(looked_at, windows), windows, classes, folds))
        if progress is not None:
            progress(len(judged), len(candidates))
    if not judged:
        return None
    best = best_of(judged, len(rows))
    folds_used = int(folds.max()) + 1
    return WindowChoice(
        windows=best.windows,
        smoothing=best.smoothing,
        accuracy=best.accuracy,
        candidates=len(judged),
        folds=folds_used,
        recordings=len(rows),
    )


def best_of(judged: Sequence[Judgement], recordings: int) -> Judgement:
    """Return the candidate of the best accuracy; of equally accurate ones, by margin, and then the smallest.

    See :data:`TOLERANCE` and :data:`MARGIN_KEPT` for what counts as equal.
    """
    highest = max(candidate.accuracy for candidate in judged)
    error = np.sqrt(highest * (1 - highest) / recordings)
    # The slack makes up for the rounding of means.
    least_accuracy = highest - TOLERANCE * error - 1e-9
    accurate = [candidate for candidate in judged if candidate.accuracy >= least_accuracy]
    widest = max(candidate.margin for candidate in accurate)
    # If the widest margin is negative, 0.9 of it would be above it: then only the widest is left.
    least_margin = min(MARGIN_KEPT * widest, widest)
    clear = [candidate for candidate in accurate if candidate.margin >= least_margin]
    return min(clear, key=lambda candidate: (candidate.hidden, -candidate.margin))


def judge(
    hidden: Float32Array, windows: WindowParameters, classes: IntArray, folds: IntArray
) -> Judgement:
    """Return how well the hidden spikes (samples, hidden) of some windows tell the classes apart."""
    scores = cross_validate(hidden @ hidden.T, classes, folds)
    rows = np.arange(len(classes))
    accuracies = np.empty(len(SMOOTHINGS))
    margins = np.empty(len(SMOOTHINGS))
    for number, score in enumerate(scores):
        right = score.argmax(axis=1) == classes
        accuracies[number] = np.mean(
            [right[classes == label].mean() for label in np.unique(classes)]
        )
        score_of_others = score.copy()
        score_of_others[rows, classes] = -np.inf
        lead = score[rows, classes] - score_of_others.max(axis=1)
        # The maximum avoids a division by 0: if all recordings are equal, the lead does not vary at all.
        margins[number] = lead.mean() / max(float(lead.std()), 1e-9)
    # Sorted by accuracy, and then by margin: lexsort sorts by its last key first.
    best = int(np.lexsort((margins, accuracies))[-1])
    return Judgement(
        windows=windows,
        smoothing=SMOOTHINGS[best],
        hidden=hidden.shape[1],
        accuracy=float(accuracies[best]),
        margin=float(margins[best]),
    )


def balanced_rows(labels: IntArray, most: int, seed: int) -> IntArray:
    """Return up to ``most`` sorted rows, drawn evenly from the classes; all rows if there are no more."""
    if len(labels) <= most:
        return np.arange(len(labels), dtype=np.int64)
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, _DRAW_ROWS])))
    # Every recording gets a turn: one of each class in turn 0, one in turn 1, ... The fraction puts the
    # classes within a turn in a random order. The first ``most`` in this order are taken.
    turn = np.zeros(len(labels))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        turn[members] = rng.permutation(len(members)) + rng.random(len(members))
    return np.sort(np.argsort(turn, kind="stable")[:most])


def fold_numbers(classes: IntArray, seed: int) -> IntArray | None:
    """Return the fold of every recording, (samples,), with each class spread evenly over the folds.

    None if fewer than two classes have two recordings.
    """
    sizes = np.bincount(classes)
    if np.count_nonzero(sizes >= 2) < 2:
        return None
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, _DRAW_FOLDS])))
    folds = np.zeros(len(classes), dtype=np.int64)
    for label in range(len(sizes)):
        members = rng.permutation(np.flatnonzero(classes == label))
        folds[members] = np.arange(len(members)) % FOLDS
    return folds


def candidate_windows(spikes: ByteArray, polarities: int) -> list[WindowParameters]:
    """Return windows as long as the recording, half as long, and so on, each with several sets of levels.

    Windows overlap by half. Candidates with more hidden neurons than a network or an output can have are left out.
    """
    samples, steps, channels = spikes.shape
    candidates: list[WindowParameters] = []
    length = steps
    while length:
        stride = max(1, length // 2)
        # 50 to 100 recordings show the distribution of counts well enough.
        counts = window_counts(spikes[:: max(1, samples // 50)], length, stride)
        for levels in candidate_levels(counts):
            windows = WindowParameters(length, stride, levels)
            of_channel = windows.of_channel(steps)
            fits = (
                of_channel * polarities <= AXONS_OF_CORE
                and of_channel * channels <= MAX_WINDOW_NEURONS
                and of_channel * channels * samples <= MOST_VALUES
            )
            if fits:
                candidates.append(windows)
        length //= 2
    return candidates


def candidate_levels(counts: AnyArray) -> list[tuple[int, ...]]:
    """Return sets of levels to try for windows with such counts of events.

    They are 1; 1 and 2; 1 to 4; and levels at evenly spaced quantiles of the counts. None exceeds the largest count.
    """
    most = max(1, int(counts.max(initial=1)))
    # From 2 % to 98 %, to leave out counts that hardly any recording has.
    quantiles = np.quantile(counts, np.linspace(0.02, 0.98, MOST_LEVELS), method="nearest")
    at_quantiles = sorted({max(1, int(count)) for count in quantiles} | {1})
    first_levels = [tuple(range(1, 1 + min(top, most))) for top in (1, 2, 4)]
    return sorted({*first_levels, tuple(at_quantiles)})


def window_counts(spikes: ByteArray, length: int, stride: int) -> IntArray:
    """Return the events of every channel in every window, (samples, windows, channels)."""
    samples, steps, channels = spikes.shape
    # The events before each step; those in a window are the difference of two entries.
    before = np.zeros((samples, steps + 1, channels), dtype=np.int32)
    np.cumsum(spikes, axis=1, out=before[:, 1:])
    starts = np.arange(0, steps - length + 1, stride)
    return np.asarray(before[:, starts + length] - before[:, starts])


def window_spikes(spikes: ByteArray, windows: WindowParameters) -> Float32Array:
    """Return the spikes of the hidden neurons, (samples, hidden).

    Their order is not that of the network, which does not matter for inner products.
    """
    counts = window_counts(spikes, windows.steps, windows.stride)
    reaches_level: list[BoolArray] = [counts >= level for level in windows.levels]
    return np.concatenate(reaches_level, axis=2).reshape(len(spikes), -1).astype(np.float32)


def cross_validate(products: AnyArray, classes: IntArray, folds: IntArray) -> FloatArray:
    """Return the scores of every smoothing, (smoothings, samples, classes), given inner products of recordings.

    Each recording is scored by prototypes of the other folds.
    """
    scores = np.zeros((len(SMOOTHINGS), len(classes), int(classes.max()) + 1))
    for fold in range(int(folds.max()) + 1):
        training = np.flatnonzero(folds != fold)
        held_out = np.flatnonzero(folds == fold)
        scores[:, held_out] = prototype_scores(
            products.astype(np.float64), classes, training, held_out
        )
    return scores


def prototype_scores(
    products: FloatArray, classes: IntArray, training: IntArray, held_out: IntArray
) -> FloatArray:
    """Return the class scores (smoothings, held out, classes) of recordings by prototypes of the training ones.

    The equation is in the module's docstring; its letters are in the comments.
    """
    onehot = np.eye(int(classes.max()) + 1)[classes[training]]
    sizes = onehot.sum(axis=0)
    means = onehot / np.maximum(sizes, 1)  # M
    among = products[np.ix_(training, training)]  # G
    # C G and C G C^T, with C applied as a subtraction.
    centred = among - (means.T @ among)[classes[training]]
    apart = centred - (centred @ means)[:, classes[training]]
    # Eigenvectors of C G C^T make the system diagonal, so that every smoothing is solved at little cost.
    values, vectors = np.linalg.eigh(apart)
    turned = vectors.T @ (centred @ means)
    scores = np.empty((len(SMOOTHINGS), len(held_out), len(sizes)))
    for number, smoothing in enumerate(SMOOTHINGS):
        # As in set_prototypes: the mean squared distance to the prototypes, and never 0.
        ridge = smoothing * np.trace(apart) / len(training) + np.finfo(np.float32).tiny
        # Rounding may make eigenvalues of 0 slightly negative.
        solved = vectors @ (turned / (np.maximum(values, 0.0) + ridge)[:, np.newaxis])
        # B, with C^T = I - onehot M^T applied as a subtraction.
        outputs = means - solved + means @ (onehot.T @ solved)
        on_itself = (means * (among @ outputs)).sum(axis=0)
        scores[number] = products[np.ix_(held_out, training)] @ outputs - 0.5 * on_itself
    # A class of which all recordings were held out is never right: -1e9 is below all scores.
    scores[:, :, sizes == 0] = -1e9
    return scores


def levels_text(levels: Sequence[int]) -> str:
    """Return levels as the option ``window_levels`` has them."""
    return " ".join(map(str, levels))
