"""Which windows tell the recordings of a train part apart: those of the best cross-validation.

Every candidate is judged as ``optimizer: prototypes`` would use it (:mod:`locsnn_compile.training.prototypes`), on
folds of the train part. Scores need inner products of recordings alone, so a candidate costs a matrix of recordings by
recordings, however many hidden neurons it has. With G = H H^T of the hidden spikes H (recordings, hidden), M the
(recordings, classes) matrix of which a column averages over a class, and C = I - M onehot^T that takes the mean of its
class from every recording:

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
SMOOTHINGS = (0.02, 0.1, 0.5, 2.0)
"""Smoothings tried; see :func:`locsnn_compile.training.prototypes.set_prototypes`."""
MOST_RECORDINGS = 600
"""Recordings that are looked at, evenly from all classes: with more, the order of the candidates hardly changes."""
MOST_LEVELS = 8
MOST_VALUES = 50_000_000
"""Largest number of hidden spikes of a candidate at once: 200 MB."""
TOLERANCE = 1.0
"""Accuracies count as equal within this number of standard errors of the best; then margins decide."""
MARGIN_KEPT = 0.9
"""Margins count as equal from this share of the best on; then the fewest hidden neurons win."""


class Judgement(Frozen):
    """How one candidate did in cross-validation, with the best of :data:`SMOOTHINGS`.

    ``accuracy``: the mean over classes. ``margin``: by how much the score of the right class exceeds the best other
    one, on average over recordings, in standard deviations over recordings. It tells candidates apart of which each
    is right about every recording.
    """

    windows: WindowParameters
    smoothing: float
    hidden: int
    accuracy: float
    margin: float


class WindowChoice(Frozen):
    """The chosen windows and smoothing, and what they were chosen by.

    ``accuracy`` is the mean over classes of cross-validation; ``candidates`` is the number of windows tried.
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
    """Return the windows for recordings (samples, steps, channels); None if fewer than two classes have two recordings.

    ``progress`` is called with the number of candidates judged and to judge.
    """
    rows = balanced_rows(labels, MOST_RECORDINGS, seed)
    looked_at = spikes[rows]
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
        best.windows, best.smoothing, best.accuracy, len(judged), folds_used, len(rows)
    )


def best_of(judged: Sequence[Judgement], recordings: int) -> Judgement:
    """Return the candidate of the best accuracy; among equal ones by margin, then by fewest hidden neurons."""
    highest = max(candidate.accuracy for candidate in judged)
    error = np.sqrt(highest * (1 - highest) / recordings)
    accurate = [row for row in judged if row.accuracy >= highest - TOLERANCE * error - 1e-9]
    widest = max(candidate.margin for candidate in accurate)
    clear = [row for row in accurate if row.margin >= min(MARGIN_KEPT * widest, widest)]
    return min(clear, key=lambda row: (row.hidden, -row.margin))


def judge(
    hidden: Float32Array, windows: WindowParameters, classes: IntArray, folds: IntArray
) -> Judgement:
    """Return how hidden spikes (samples, hidden) of some windows tell the classes apart."""
    scores = cross_validate(hidden @ hidden.T, classes, folds)
    rows = np.arange(len(classes))
    accuracies, margins = np.empty(len(SMOOTHINGS)), np.empty(len(SMOOTHINGS))
    for number, score in enumerate(scores):
        right = score.argmax(axis=1) == classes
        accuracies[number] = np.mean(
            [right[classes == label].mean() for label in np.unique(classes)]
        )
        others = score.copy()
        others[rows, classes] = -np.inf
        ahead = score[rows, classes] - others.max(axis=1)
        # Of equal recordings, margins do not vary at all.
        margins[number] = ahead.mean() / max(float(ahead.std()), 1e-9)
    best = int(np.lexsort((margins, accuracies))[-1])
    return Judgement(
        windows,
        SMOOTHINGS[best],
        hidden.shape[1],
        float(accuracies[best]),
        float(margins[best]),
    )


def balanced_rows(labels: IntArray, most: int, seed: int) -> IntArray:
    """Return up to ``most`` sorted rows, drawn evenly from the classes; all rows if there are no more."""
    if len(labels) <= most:
        return np.arange(len(labels), dtype=np.int64)
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 3])))
    turn = np.zeros(len(labels))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        turn[members] = rng.permutation(len(members)) + rng.random(len(members))
    return np.sort(np.argsort(turn, kind="stable")[:most])


def fold_numbers(classes: IntArray, seed: int) -> IntArray | None:
    """Return the fold of every recording, (samples,), classes spread evenly; None if fewer than two have two."""
    sizes = np.bincount(classes)
    if np.count_nonzero(sizes >= 2) < 2:
        return None
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 4])))
    folds = np.zeros(len(classes), dtype=np.int64)
    for label in range(len(sizes)):
        members = rng.permutation(np.flatnonzero(classes == label))
        folds[members] = np.arange(len(members)) % FOLDS
    return folds


def candidate_windows(spikes: ByteArray, polarities: int) -> list[WindowParameters]:
    """Return windows of all steps, of half of them, and so on, with the levels that their counts ask for.

    Windows overlap by half. Those with more hidden neurons than a network or an output can have are left out.
    """
    samples, steps, channels = spikes.shape
    found: list[WindowParameters] = []
    length = steps
    while length:
        stride = max(1, length // 2)
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
                found.append(windows)
        length //= 2
    return found


def candidate_levels(counts: AnyArray) -> list[tuple[int, ...]]:
    """Return numbers of events to tell apart in windows of such counts: few from 1 on, and some spread over them."""
    most = max(1, int(counts.max(initial=1)))
    quantiles = np.quantile(counts, np.linspace(0.02, 0.98, MOST_LEVELS), method="nearest")
    spread = sorted({max(1, int(count)) for count in quantiles} | {1})
    sets = [tuple(range(1, 1 + min(top, most))) for top in (1, 2, 4)] + [tuple(spread)]
    return sorted(set(sets))


def window_counts(spikes: ByteArray, length: int, stride: int) -> IntArray:
    """Return the events of every channel in every window, (samples, windows, channels)."""
    samples, steps, channels = spikes.shape
    before = np.zeros((samples, steps + 1, channels), dtype=np.int32)
    np.cumsum(spikes, axis=1, out=before[:, 1:])
    starts = np.arange(0, steps - length + 1, stride)
    return np.asarray(before[:, starts + length] - before[:, starts])


def window_spikes(spikes: ByteArray, windows: WindowParameters) -> Float32Array:
    """Return the spikes of the hidden neurons, (samples, hidden), in an order of their own."""
    counts = window_counts(spikes, windows.steps, windows.stride)
    reached: list[BoolArray] = [counts >= level for level in windows.levels]
    return np.concatenate(reached, axis=2).reshape(len(spikes), -1).astype(np.float32)


def cross_validate(products: AnyArray, classes: IntArray, folds: IntArray) -> FloatArray:
    """Return the scores of every smoothing, (smoothings, samples, classes), given inner products of recordings.

    Each recording is scored by prototypes of the other folds.
    """
    scores = np.zeros((len(SMOOTHINGS), len(classes), int(classes.max()) + 1))
    for fold in range(int(folds.max()) + 1):
        learned, held = np.flatnonzero(folds != fold), np.flatnonzero(folds == fold)
        scores[:, held] = prototype_scores(products.astype(np.float64), classes, learned, held)
    return scores


def prototype_scores(
    products: FloatArray, classes: IntArray, learned: IntArray, held: IntArray
) -> FloatArray:
    """Return class scores (smoothings, held, classes) of recordings ``held``, learned from the others."""
    own = np.eye(int(classes.max()) + 1)[classes[learned]]
    sizes = own.sum(axis=0)
    means = own / np.maximum(sizes, 1)
    among = products[np.ix_(learned, learned)]
    # C G C^T and C G M, with C applied as a subtraction.
    centred = among - (means.T @ among)[classes[learned]]
    apart = centred - (centred @ means)[:, classes[learned]]
    values, vectors = np.linalg.eigh(apart)
    turned = vectors.T @ (centred @ means)
    scores = np.empty((len(SMOOTHINGS), len(held), len(sizes)))
    for number, smoothing in enumerate(SMOOTHINGS):
        ridge = smoothing * np.trace(apart) / len(learned) + np.finfo(np.float32).tiny
        solved = vectors @ (turned / (np.maximum(values, 0.0) + ridge)[:, np.newaxis])
        # C^T takes from each class's mean what its recordings have together.
        outputs = means - solved + means @ (own.T @ solved)
        on_itself = (means * (among @ outputs)).sum(axis=0)
        scores[number] = products[np.ix_(held, learned)] @ outputs - 0.5 * on_itself
    # A class of which all recordings were held out is never right: -1e9 is below all scores.
    scores[:, :, sizes == 0] = -1e9
    return scores


def levels_text(levels: Sequence[int]) -> str:
    """Return levels as the option ``window_levels`` has them."""
    return " ".join(map(str, levels))
