"""Integers for SRM neurons and the weights onto them, rounded for calibration recordings.

The *ideal* weights are the real numbers with which the chip's filters, whose decays are rounded, follow the float
potential best. A least-squares fit on the calibration recordings gives them; its sums are the :class:`Drive` of a
population. The ideal weights are then rounded together, neuron by neuron.

A larger scale (more counts of the register for the same potential) makes finer weights, but clips more potentials. So a
few scales are tried, and each neuron takes the one whose potential has the least error on the calibration recordings,
where errors near the threshold matter most.
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
"""Largest number of inputs of a population for which the Gram matrix (inputs x inputs) is computed."""
RIDGE = 0.16
"""Strength of the ridge (Tikhonov) term that pulls the ideal weights towards the trained ones. It is divided by the
number of recordings: the fewer there are, the less their correlations tell about others. Chosen by hand."""
SCALES = 2.0 ** (-0.45 * np.arange(6))
"""Scales that are tried, as shares of the largest: six, down to about a fifth. With two populations on a core, they
take 12 of its 16 threshold profiles. The ratio was chosen by hand."""
HEADROOM_MIN = 4
"""The voltage register holds at least this many thresholds; chosen by hand."""
CURRENT_ROOM = 4
"""The current register holds at least this multiple of the largest current of the calibration recordings, so that other
recordings do not wrap it; chosen by hand."""
NEAR = 0.3
"""An error of the potential has weight ``exp(-distance / NEAR)``, with the distance from threshold in thresholds.
Chosen by hand."""
BEAM = 8
"""Candidates per neuron of the beam search that rounds weights."""
BEAM_TO_COMPARE = 1
"""The same when scales are only compared, which is faster and ranks scales well enough."""


class Drive(Frozen, eq=False):
    """What the n inputs of m neurons do on the calibration recordings.

    With x (n,), what a weight of 1 from each input adds to the chip's potential in a step:

    - ``gram`` (n, n): the mean over all steps of ``x x^T``, with a ridge on its diagonal
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
        """The Gram matrix, prepared for rounding weights together."""
        return Metric.of(self.gram)


_drives: WeakKeyDictionary[Calibration, dict[Any, Drive | None]] = WeakKeyDictionary()
"""A cache of drives, by the arguments of :func:`drive_of`: most settings that ``auto`` compares have the same ones.

It is dropped with the calibration recordings."""


def drive_of(
    neuron: SrmAlpha,
    incoming: tuple[Projection, ...],
    decays: tuple[int, int],
    gain: float,
    calibration: Calibration,
) -> Drive | None:
    """Return the drive of SRM neurons through an alpha dendrite with these decays (of current and voltage) and gain.

    Return None for weights that are sparse or have a delay each, for more inputs than :data:`INPUTS_MAX`, and if no
    input spikes.
    """
    drives = _drives.setdefault(calibration, {})
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
    """Compute the drive: solve ``ideal (gram + ridge I) = potential_by_input + ridge (gain weights)``."""
    matrices = [p.weights for p in incoming]
    if (
        not incoming
        or any(sparse.issparse(matrix) for matrix in matrices)
        or any(np.ndim(p.delay) for p in incoming)
    ):
        return None
    weights = np.hstack(matrices)  # the columns are the inputs of all projections
    m, n = weights.shape
    if n > INPUTS_MAX:
        return None
    a, c = alpha_recursion(neuron.tau_sr)
    keep_u, keep_v = (float(keep) for keep in share_kept(np.array(decays)))
    gram = np.zeros((n, n))
    potential_by_input = np.zeros((m, n))  # sums of the float potential times x
    spike_count = np.zeros(n)
    peak_current = np.zeros(m)
    steps = 0
    for rows in batches(calibration.samples):
        spikes = np.concatenate(
            [_arriving(calibration.spikes[p.source][rows], p) for p in incoming], axis=2
        )
        x = _filtered(spikes, keep_u, keep_v).reshape(-1, n)
        exact = _filtered(spikes, a, a).reshape(-1, n) * c
        float_potential = exact @ weights.T
        gram += x.T @ x
        potential_by_input += float_potential.T @ x
        spike_count += spikes.sum(axis=(0, 1))
        # A second filter that keeps nothing leaves the current alone.
        current = _filtered(spikes, keep_u, 0.0).reshape(-1, n) @ (gain * weights).T
        peak_current = np.maximum(peak_current, np.abs(current).max(axis=0))
        steps += len(x)
    power = float(np.trace(gram)) / n
    if power == 0.0:
        return None
    ridge = RIDGE / calibration.samples * power
    gram[np.diag_indices(n)] += ridge
    trained = gain * weights
    ideal = np.linalg.solve(gram, (potential_by_input + ridge * trained).T).T
    return Drive(
        gram=gram / steps,
        ideal=ideal,
        rate=spike_count / calibration.samples,
        peak_current=peak_current,
    )


def _arriving(spikes: ByteArray, p: Projection) -> FloatArray:
    """Return spikes (batch, steps, n) of a projection's source, shifted to the steps at which they arrive."""
    late = 1 + int(p.delay)  # a spike acts one step later at the earliest
    shifted = np.zeros(spikes.shape)
    shifted[:, late:] = spikes[:, :-late]
    return shifted


def _filtered(arriving: FloatArray, keep_u: float, keep_v: float) -> FloatArray:
    """Return the response of two first-order filters in a row, (batch, steps, n).

        y(t) = x(t) + (keep_u + keep_v) y(t - 1) - keep_u keep_v y(t - 2)

    The direct form II, transposed: two states carry what earlier responses add to the next two.
    """
    batch, steps, n = arriving.shape
    response = np.empty_like(arriving)
    for_next_step = np.zeros((batch, n))
    for_step_after_next = np.zeros((batch, n))
    for step in range(steps):
        np.add(arriving[:, step], for_next_step, out=response[:, step])
        for_next_step = for_step_after_next + (keep_u + keep_v) * response[:, step]
        for_step_after_next = -(keep_u * keep_v) * response[:, step]
    return response


class _Task(Task, eq=False):
    """A population to round, the recordings to round it for, and the drive of its inputs on them."""

    calibration: Calibration
    neuron: SrmAlpha
    drive: Drive


def fine_srm(neuron: SrmAlpha, plain_task: Task, plain: Scaled) -> Rounded | None:
    """Return neurons and weights that are rounded for the calibration recordings of a task.

    ``plain`` has the integers that the strategy chose without recordings. Return None if there is nothing to round for:
    no recordings, no step of rounding that needs them, no dendrites, or no drive.
    """
    neurons = plain.neuron
    rounding = plain_task.rounding
    is_fine = rounding.error_aware or rounding.scaled_apart
    if plain_task.calibration is None or not is_fine or not isinstance(neurons, ChipSrm):
        return None
    decays = (int(neurons.decay_u[0]), int(neurons.decay_v[0]))
    drive = drive_of(
        neuron, plain_task.incoming, decays, float(plain.gain[0]), plain_task.calibration
    )
    if drive is None:
        return None
    task = _Task(**vars(plain_task), neuron=neuron, drive=drive)
    # Taps were computed for one scale, so only neurons with a refractory dendrite can change theirs.
    if rounding.scaled_apart and neurons.refractory.decay is not None:
        neurons = _scaled_apart(task, neurons)
    quanta, grade, split, grades = _rounded(task, neurons, BEAM)
    # Divide the columns of all inputs among the projections again.
    first_columns = _first_columns(task)
    columns = zip(
        task.incoming,
        np.split(quanta, first_columns, axis=1),
        np.split(grade, first_columns, axis=1),
        np.split(split, first_columns, axis=1),
        strict=True,
    )
    projections = [
        in_grades(p, quanta_onto, grade_onto, is_split, grades, neurons.dendrites)
        for p, quanta_onto, grade_onto, is_split in columns
    ]
    return Scaled(neurons, _scale(task, neurons), plain.gain, plain.exponent), projections


def _scale(task: _Task, neurons: ChipSrm) -> FloatArray:
    """Return how many counts of the voltage register a potential of 1 is, (n,); theta is the least v that spikes."""
    scale: FloatArray = loihi_inverse.least_to_spike(neurons.threshold) / task.neuron.theta
    return scale


def _scaled_apart(task: _Task, neurons: ChipSrm) -> ChipSrm:
    """Return the neurons, each at the scale with which its potential has the least error.

    A scale is set by the threshold mantissa. The last one that is tried is the plain one, which is always allowed.
    """
    dendrites = neurons.dendrites
    of_dendrite = of_a_dendrite(task.neuron, dendrites)
    largest_threshold = _largest_threshold(task, of_dendrite, dendrites)
    exact_thresholds = np.append(SCALES * largest_threshold, neurons.threshold[0])
    charge = dendrite_charge(of_dendrite, task.where)
    thresholds, mantissas, exponent = whole_mantissas(charge, exact_thresholds, own_grid(task.chip))
    size = task.population.size
    # One large population that holds all neurons at the first scale, then all at the second, and so on.
    candidates = _with_thresholds(
        neurons, np.repeat(thresholds, size), np.repeat(mantissas, size), exponent
    )
    errors = _errors(task, candidates, len(thresholds))
    errors[:-1][thresholds[:-1, None] > dendrites * _threshold_limits(task)] = np.inf
    best = errors.argmin(axis=0)
    return _with_thresholds(neurons, thresholds[best], mantissas[best], exponent)


def _with_thresholds(
    neurons: ChipSrm, thresholds: IntArray, mantissas: IntArray, exponent: int
) -> ChipSrm:
    """Return neurons with the decays of ``neurons``, and these threshold and refractory mantissas, (n,)."""
    refractory_decay = neurons.refractory.decay
    assert refractory_decay is not None
    size = len(thresholds)
    return ChipSrm.of(
        size,
        decay_u=neurons.decay_u[0],
        decay_v=neurons.decay_v[0],
        threshold=thresholds,
        refractory=Refractory.of(
            size, mantissas[None], exponent, refractory_decay=refractory_decay[0]
        ),
        dendrites=neurons.dendrites,
    )


def _largest_threshold(task: _Task, of_dendrite: SrmAlpha, dendrites: int) -> float:
    """Return the largest threshold mantissa that the registers and the weight of an own spike allow.

    ``of_dendrite`` has the refractory kernel of one of the ``dendrites``, whose voltages add up in the soma.
    """
    registers = task.chip.registers
    limits = [
        registers.threshold_mantissa_max,
        float(loihi.in_units(dendrites * registers.voltage_max / HEADROOM_MIN)),
    ]
    own_charge = dendrite_charge(of_dendrite, task.where)
    if own_charge:
        # The charge is in thresholds, each of which is less than the mantissa + 1.
        limits.append(heaviest_weight(task.chip) / own_charge - 1)
    return min(limits)


def _threshold_limits(task: _Task) -> FloatArray:
    """Return the largest threshold mantissas (m,) at which weights fit a format, and charge and current the registers.

    They are for a neuron with one dendrite; with more, each takes its share. The charge fits whatever the input is, the
    current only on the calibration recordings.
    """
    registers = task.chip.registers
    ideal = task.drive.ideal
    largest = np.abs(ideal).max(axis=1, initial=0.0)
    one_sign = np.maximum(np.maximum(ideal, 0).sum(axis=1), np.maximum(-ideal, 0).sum(axis=1))
    # Each limit is in units per potential of 1. A neuron without weights, or with negligible ones, has no limit.
    with np.errstate(divide="ignore", over="ignore"):
        weight_bits = task.grid.weight_bits
        by_weight = float(largest_multiple(weight_bits) << coarsest(weight_bits)) / largest
        by_charge = loihi.charge_span(registers.charge_bits) / one_sign
        largest_current = loihi.in_units(registers.half_current)
        by_current = largest_current / CURRENT_ROOM / task.drive.peak_current
        units_per_potential = np.minimum(np.minimum(by_weight, by_charge), by_current)
        # A threshold is less than its mantissa + 1, in units.
        limits: FloatArray = units_per_potential * task.neuron.theta - 1
    return limits


def _errors(task: _Task, candidates: ChipSrm, count: int) -> FloatArray:
    """Return the error of each neuron's potential for each of ``count`` candidates, (count, m).

    ``candidates`` holds the population ``count`` times. Inputs and own spikes are those of the float network, so that
    one wrong spike does not cause further errors. The error is the sum over all steps of all recordings, weighted by
    how near the float potential is to the threshold.
    """
    calibration = task.calibration
    theta = task.neuron.theta
    scale = _scale(task, candidates)
    quanta, *_ = _rounded(task, candidates, BEAM_TO_COMPARE)
    # The weights of all neurons, dendrite by dendrite.
    weights = np.concatenate(
        shares(loihi.in_registers(quanta), candidates.dendrites, loihi.in_registers(1))
    )
    weights_of_projection = np.split(weights, _first_columns(task), axis=1)
    name = task.population.name
    error = np.zeros(len(scale))
    for rows in batches(calibration.samples):
        # The float network's spikes and potentials, repeated for every candidate.
        own_spikes = np.tile(calibration.spikes[name][rows].astype(np.bool_), (1, 1, count))
        exact = np.tile(calibration.potential[name][rows], (1, 1, count))
        nearness = np.exp(-np.abs(exact / theta - 1) / NEAR)
        batch, steps, neurons = own_spikes.shape
        charge = np.zeros((batch, steps, len(weights)), dtype=np.int64)
        for p, matrix in zip(task.incoming, weights_of_projection, strict=True):
            late = 1 + int(p.delay)
            sent = charge_of(calibration.spikes[p.source][rows], matrix)
            charge[:, late:] += sent[:, :-late]
        state = ChipSrmSteps(candidates, batch, neurons, task.chip.registers)
        for step in range(steps):
            _, potential = state.step(charge[:, step])
            # The next step sees the own spikes of the float network instead of the candidate's.
            state.fired = own_spikes[:, step]
            error_of_step = np.abs(potential / scale - exact[:, step])
            error += (error_of_step * nearness[:, step]).sum(axis=0)
    return error.reshape(count, -1)


def _rounded(
    task: _Task, neurons: ChipSrm, beam: int
) -> tuple[IntArray, IntArray, BoolArray, Grades]:
    """Round the ideal weights onto neurons, which hold the population once or several times.

    Returns the weights in quanta, (k, n), summed over the dendrites, the grade of each dendrite's share (k, n), which
    weights are split (k, n), and all grades.
    """
    scale = _scale(task, neurons)
    times = len(scale) // task.population.size
    ideal = np.tile(task.drive.ideal, (times, 1)) * loihi.in_units(scale[:, None])
    magnitude = np.abs(ideal) / neurons.dendrites
    grades = grades_for(float(magnitude.max()), task, neurons)
    grade = grades.grade(magnitude)
    # A trained weight of 0 stays without a synapse, although the ideal weight would not be 0.
    has_synapse = np.tile(np.hstack([p.weights for p in task.incoming]) != 0, (times, 1))
    split = _worth_splitting(task, grades, grade, has_synapse)
    finest_grade = np.where(split, grades.second_grade(grade), grade)
    step = np.where(has_synapse, 1 << finest_grade, 0)
    largest = neurons.dendrites * grades.largest_of(grade)
    if task.rounding.error_aware:
        quanta = round_together(task.drive.metric, ideal, step, largest, beam)
    else:
        quanta = nearest(ideal, step, largest)
    return quanta, grade, split, grades


def _worth_splitting(
    task: _Task, grades: Grades, grade: IntArray, has_synapse: BoolArray
) -> BoolArray:
    """Mark the share of weights with the best ratio of squared error saved to synaptic operations added."""
    # The mean squared error of rounding to multiples of 2^k is in proportion to 4^k, and to the power of the input.
    power = np.diag(task.drive.gram)
    error_saved = (4.0**grade - 4.0 ** grades.second_grade(grade)) * power
    # A silent input adds no operations: it counts as one spike in all recordings, and its power is the ridge.
    spikes_per_recording = np.maximum(task.drive.rate, 1 / task.calibration.samples)
    value = np.where(has_synapse, error_saved / spikes_per_recording, 0.0)
    count = round(task.rounding.split * int(has_synapse.sum()))
    chosen = np.zeros(value.shape, dtype=np.bool_)
    most_valuable = np.argsort(-value, axis=None, kind="stable")[:count]
    chosen.flat[most_valuable] = True
    return chosen & (value > 0)


def _first_columns(task: _Task) -> IntArray:
    """Return the column at which the weights of each projection after the first one begin."""
    return np.cumsum([p.weights.shape[1] for p in task.incoming])[:-1]
