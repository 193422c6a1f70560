"""Integers for SRM neurons and the weights onto them, rounded for calibration recordings.

Ideal weights are the real numbers with which the chip's filters follow the float potential best; they are rounded
together, neuron by neuron. A larger scale makes finer weights, but clips more potentials. So a few scales are tried,
and each neuron takes the one whose potential errs least on the calibration recordings, above all near the threshold.
The :class:`Drive` of a population is what its inputs add to its potentials on these recordings, and what they should.
"""

from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.arithmetic.loihi_inverse import share_kept
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.data.recordings import batches
from locsnn_compile.network.chip_neurons import ChipSrm, Refractory
from locsnn_compile.network.neurons import SrmAlpha, alpha_recursion
from locsnn_compile.network.projections import Projection
from locsnn_compile.network.projections import charge as charge_of
from locsnn_compile.passes.rounding.grades import (
    Grades,
    coarsest,
    grades_for,
    in_grades,
    largest_multiple,
    nearest,
    shares,
)
from locsnn_compile.passes.rounding.task import Rounded, Scaled, Task, heaviest_weight, own_grid
from locsnn_compile.passes.rounding.together import Metric, round_together
from locsnn_compile.passes.srm.quantize import dendrite_charge, of_a_dendrite, whole_mantissas
from locsnn_compile.reference.evaluate import Calibration
from locsnn_compile.reference.integer_neurons import ChipSrmSteps

INPUTS_MAX = 2048
"""Largest number of inputs of a population for which the Gram matrix is made."""
RIDGE = 0.16
"""Strength of the ridge that holds weights in place, as a share of the inputs' mean power over the number of
recordings: the fewer recordings, the less their correlations tell about others."""
SCALES = 2.0 ** (-0.45 * np.arange(6))
"""Scales that are tried, as shares of the largest: for two populations on a core, 12 of its 16 threshold profiles."""
HEADROOM_MIN = 4
"""The voltage register holds at least this many thresholds."""
CURRENT_ROOM = 4
"""The current register holds at least this multiple of the largest current of the calibration recordings."""
NEAR = 0.3
"""An error of the potential has weight ``exp(-distance / NEAR)``, with the distance from threshold in thresholds."""
BEAM = 8
"""Candidates per neuron when weights are rounded."""
BEAM_TO_COMPARE = 1
"""Candidates per neuron when scales are only compared."""


class Drive(Frozen, eq=False):
    """Moments of x (n,), which is what a weight of 1 on each input adds to the chip's potential in a step.

    - ``gram`` (n, n): the mean of ``x x^T``, with a ridge on its diagonal
    - ``ideal`` (m, n): real weights with the least mean squared error from the float potential, in its unit
    - ``rate`` (n,): spikes of each input per recording
    - ``peak_current`` (m,): the largest magnitude of the current, in the unit of the potential
    """

    gram: FloatArray
    ideal: FloatArray
    rate: FloatArray
    peak_current: FloatArray

    @cached_property
    def metric(self) -> Metric:
        """The metric in which roundings are compared with the ideal weights."""
        return Metric.of(self.gram)


_known: WeakKeyDictionary[Calibration, dict[Any, Drive | None]] = WeakKeyDictionary()
"""Drives by what they were made from, in which compared settings seldom differ, as long as the recordings are held."""


def drive_of(
    neuron: SrmAlpha,
    incoming: tuple[Projection, ...],
    decays: tuple[int, int],
    gain: float,
    calibration: Calibration,
) -> Drive | None:
    """Return the drive of SRM neurons through an alpha dendrite with these decays and this gain.

    Return None for weights that are sparse or have delays of their own, for more inputs than :data:`INPUTS_MAX`, and
    for silent inputs.
    """
    drives = _known.setdefault(calibration, {})
    key = (neuron, incoming, decays, gain)
    if key not in drives:
        drives[key] = _drive_of(neuron, incoming, decays, gain, calibration)
    return drives[key]


def _drive_of(
    neuron: SrmAlpha,
    incoming: tuple[Projection, ...],
    decays: tuple[int, int],
    gain: float,
    calibration: Calibration,
) -> Drive | None:
    weights = [p.weights for p in incoming]
    if (
        not incoming
        or any(sparse.issparse(w) for w in weights)
        or any(np.ndim(p.delay) for p in incoming)
    ):
        return None
    joined = np.hstack(weights)
    m, n = joined.shape
    if n > INPUTS_MAX:
        return None
    a, c = alpha_recursion(neuron.tau_sr)
    keep_u, keep_v = (float(keep) for keep in share_kept(np.array(decays)))
    gram, wanted, rate, peak, steps = (
        np.zeros((n, n)),
        np.zeros((m, n)),
        np.zeros(n),
        np.zeros(m),
        0,
    )
    for rows in batches(calibration.samples):
        spikes = np.concatenate(
            [_arriving(calibration.spikes[p.source][rows], p) for p in incoming], axis=2
        )
        x = _filtered(spikes, keep_u, keep_v).reshape(-1, n)
        exact = _filtered(spikes, a, a).reshape(-1, n) * c
        gram += x.T @ x
        wanted += (exact @ joined.T).T @ x
        rate += spikes.sum(axis=(0, 1))
        current = _filtered(spikes, keep_u, 0.0).reshape(-1, n) @ (gain * joined).T
        peak = np.maximum(peak, np.abs(current).max(axis=0))
        steps += len(x)
    power = float(np.trace(gram)) / n
    if power == 0.0:
        return None
    ridge = RIDGE / calibration.samples * power
    gram[np.diag_indices(n)] += ridge
    ideal = np.linalg.solve(gram, (wanted + ridge * gain * joined).T).T
    return Drive(gram / steps, ideal, rate / calibration.samples, peak)


def _arriving(spikes: ByteArray, p: Projection) -> FloatArray:
    """Return spikes (batch, steps, n), shifted to the steps at which they arrive."""
    late = 1 + int(p.delay)
    shifted = np.zeros(spikes.shape)
    shifted[:, late:] = spikes[:, :-late]
    return shifted


def _filtered(arriving: FloatArray, keep_u: float, keep_v: float) -> FloatArray:
    """Return the response of two first-order filters in a row, (batch, steps, n)."""
    answer, before, twice_before = (
        np.empty_like(arriving),
        *np.zeros((2, len(arriving), arriving.shape[2])),
    )
    for step in range(arriving.shape[1]):
        np.add(arriving[:, step], before, out=answer[:, step])
        before = twice_before + (keep_u + keep_v) * answer[:, step]
        twice_before = -(keep_u * keep_v) * answer[:, step]
    return answer


class _Task(Task, eq=False):
    """A population to round, the recordings to round it for, and the drive of its inputs on them."""

    calibration: Calibration
    neuron: SrmAlpha
    drive: Drive


def fine_srm(neuron: SrmAlpha, known: Task, plain: Scaled) -> Rounded | None:
    """Return neurons and weights, given the plain integers of a strategy; None if there is nothing to round for."""
    neurons = plain.neuron
    rounding = known.rounding
    is_fine = rounding.error_aware or rounding.scaled_apart
    if known.calibration is None or not is_fine or not isinstance(neurons, ChipSrm):
        return None
    decays = (int(neurons.decay_u[0]), int(neurons.decay_v[0]))
    drive = drive_of(neuron, known.incoming, decays, float(plain.gain[0]), known.calibration)
    if drive is None:
        return None
    task = _Task(**vars(known), neuron=neuron, drive=drive)
    if rounding.scaled_apart and neurons.refractory.decay is not None:
        neurons = _scaled_apart(task, neurons)
    quanta, grade, split, grades = _rounded(task, neurons, BEAM)
    columns = zip(
        task.incoming,
        *(np.split(part, _ends(task), axis=1) for part in (quanta, grade, split)),
        strict=True,
    )
    projections = [in_grades(p, q, g, two, grades, neurons.dendrites) for p, q, g, two in columns]
    return Scaled(neurons, _scale(task, neurons), plain.gain, plain.exponent), projections


def _scale(task: _Task, neurons: ChipSrm) -> FloatArray:
    """Return the value of a potential of 1 in the registers of each neuron: theta is the least v that spikes."""
    scale: FloatArray = loihi_inverse.least_to_spike(neurons.threshold) / task.neuron.theta
    return scale


def _scaled_apart(task: _Task, neurons: ChipSrm) -> ChipSrm:
    """Return the neurons, each at the scale whose potential errs least; the plain scale is always allowed."""
    share, dendrites = of_a_dendrite(task.neuron, neurons.dendrites), neurons.dendrites
    wanted = np.append(SCALES * _largest_threshold(task, share, dendrites), neurons.threshold[0])
    charge = dendrite_charge(share, task.where)
    thresholds, mantissas, exponent = whole_mantissas(charge, wanted, own_grid(task.chip))
    size = task.population.size
    candidates = _at(neurons, np.repeat(thresholds, size), np.repeat(mantissas, size), exponent)
    errors = _errors(task, candidates, len(thresholds))
    errors[:-1][thresholds[:-1, None] > dendrites * _threshold_limits(task)] = np.inf
    best = errors.argmin(axis=0)
    return _at(neurons, thresholds[best], mantissas[best], exponent)


def _at(neurons: ChipSrm, thresholds: IntArray, mantissas: IntArray, exponent: int) -> ChipSrm:
    """Return neurons like ``neurons`` with these threshold and refractory mantissas, (n,)."""
    assert neurons.refractory.decay is not None
    size, (u, v) = len(thresholds), (neurons.decay_u[0], neurons.decay_v[0])
    own = Refractory.of(
        size, mantissas[None], exponent, refractory_decay=neurons.refractory.decay[0]
    )
    return ChipSrm.of(
        size,
        decay_u=u,
        decay_v=v,
        threshold=thresholds,
        refractory=own,
        dendrites=neurons.dendrites,
    )


def _largest_threshold(task: _Task, share: SrmAlpha, dendrites: int) -> float:
    """Return the largest threshold mantissa that registers, and a dendrite's ``share`` of own charges, allow."""
    registers = task.chip.registers
    own = dendrite_charge(share, task.where)
    caps = [
        registers.threshold_mantissa_max,
        float(loihi.in_units(dendrites * registers.voltage_max / HEADROOM_MIN)),
    ]
    return min(*caps, heaviest_weight(task.chip) / own - 1) if own else min(caps)


def _threshold_limits(task: _Task) -> FloatArray:
    """Return the largest threshold mantissas (m,) at which weights fit a format, and charge and current the registers.

    This is per dendrite. The charge fits whatever the input is, the current on the calibration recordings.
    """
    registers, ideal, theta = task.chip.registers, task.drive.ideal, task.neuron.theta
    largest = np.abs(ideal).max(axis=1, initial=0.0)
    one_sign = np.maximum(np.maximum(ideal, 0).sum(axis=1), np.maximum(-ideal, 0).sum(axis=1))
    # A neuron without weights, or with negligible ones, has no limit.
    with np.errstate(divide="ignore", over="ignore"):
        weight_bits = task.grid.weight_bits
        heaviest = float(largest_multiple(weight_bits) << coarsest(weight_bits)) / largest
        charge = loihi.charge_span(registers.charge_bits) / one_sign
        largest_current = loihi.in_units(registers.half_current)
        current = largest_current / CURRENT_ROOM / task.drive.peak_current
        limits: FloatArray = np.minimum(np.minimum(heaviest, charge), current) * theta - 1
    return limits


def _errors(task: _Task, candidates: ChipSrm, count: int) -> FloatArray:
    """Return the error of each neuron's potential for each of ``count`` candidates, (count, m).

    ``candidates`` holds the population ``count`` times. Inputs and own spikes are those of the float network, so that
    one error does not cause others.
    """
    calibration, theta = task.calibration, task.neuron.theta
    scale = _scale(task, candidates)
    quanta, *_ = _rounded(task, candidates, BEAM_TO_COMPARE)
    # The weights of all neurons, dendrite by dendrite.
    weights = np.concatenate(
        shares(loihi.in_registers(quanta), candidates.dendrites, loihi.in_registers(1))
    )
    columns = np.split(weights, _ends(task), axis=1)
    error = np.zeros(len(scale))
    for rows in batches(calibration.samples):
        own = np.tile(
            calibration.spikes[task.population.name][rows].astype(np.bool_), (1, 1, count)
        )
        wanted = np.tile(calibration.potential[task.population.name][rows], (1, 1, count))
        weight = np.exp(-np.abs(wanted / theta - 1) / NEAR)
        charge = np.zeros((*own.shape[:2], len(weights)), dtype=np.int64)
        for p, part in zip(task.incoming, columns, strict=True):
            late = 1 + int(p.delay)
            charge[:, late:] += charge_of(calibration.spikes[p.source][rows], part)[:, :-late]
        state = ChipSrmSteps(candidates, len(own), own.shape[2], task.chip.registers)
        for step in range(own.shape[1]):
            _, potential = state.step(charge[:, step])
            state.fired = own[:, step]
            error += (np.abs(potential / scale - wanted[:, step]) * weight[:, step]).sum(axis=0)
    return error.reshape(count, -1)


def _rounded(
    task: _Task, neurons: ChipSrm, beam: int
) -> tuple[IntArray, IntArray, BoolArray, Grades]:
    """Round the ideal weights onto neurons, which hold the population once or several times.

    Returns quanta (k, n) over all dendrites, the grade of each dendrite's share, what is split, and all grades.
    """
    scale = _scale(task, neurons)
    times = len(scale) // task.population.size
    ideal = np.tile(task.drive.ideal, (times, 1)) * loihi.in_units(scale[:, None])
    magnitude = np.abs(ideal) / neurons.dendrites
    grades = grades_for(float(magnitude.max()), task, neurons)
    grade = grades.grade(magnitude)
    present = np.tile(np.hstack([p.weights for p in task.incoming]) != 0, (times, 1))
    split = _worth_splitting(task, grades, grade, present)
    step = np.where(present, 1 << np.where(split, grades.second_grade(grade), grade), 0)
    largest = neurons.dendrites * grades.largest_of(grade)
    if task.rounding.error_aware:
        quanta = round_together(task.drive.metric, ideal, step, largest, beam)
    else:
        quanta = nearest(ideal, step, largest)
    return quanta, grade, split, grades


def _worth_splitting(task: _Task, grades: Grades, grade: IntArray, present: BoolArray) -> BoolArray:
    """Mark the share of weights with the best ratio of squared error saved to synaptic operations added."""
    saved = (4.0**grade - 4.0 ** grades.second_grade(grade)) * np.diag(task.drive.gram)
    # A silent input costs nothing, and the ridge estimates its worth.
    value = np.where(
        present, saved / np.maximum(task.drive.rate, 1 / task.calibration.samples), 0.0
    )
    count = round(task.rounding.split * int(present.sum()))
    chosen = np.zeros(value.shape, dtype=np.bool_)
    chosen.flat[np.argsort(-value, axis=None, kind="stable")[:count]] = True
    return chosen & (value > 0)


def _ends(task: _Task) -> IntArray:
    """Return the columns at which the weights of each projection after the first one begin."""
    return np.cumsum([p.weights.shape[1] for p in task.incoming])[:-1]
