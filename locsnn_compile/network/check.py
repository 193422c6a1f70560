"""The rules that a :class:`Network` must keep, whoever made it: a frontend or a user in Python.

:func:`check_network` raises ``InputError`` for the first broken rule, and names the place. Later passes rely on these
rules and do not check again.
"""

from collections.abc import Mapping

import numpy as np

from hw_model.io.records import POSITIVE, check_fields
from hw_model.mapping.graph import Axis
from hw_model.values import AnyArray
from locsnn_compile.data.recordings import clean_class_names
from locsnn_compile.errors import InputError, check_same, counted
from locsnn_compile.network.network import MOST, InputView, Network, Population
from locsnn_compile.network.neurons import TAPS, Neuron
from locsnn_compile.network.projections import ChipProjection, Projection, values_of

_Ends = dict[str, tuple[str, int]]
"""Phase and size of every view and population, between which projections run, by name."""

_LEAST = 1e-100
"""Smallest magnitude of a float that something is divided by, so that products of three quotients stay in float64."""
_MOST = 1e100
"""Largest magnitude of a float, so that products of three of them stay in float64."""


def check_network(network: Network) -> None:
    """Raise ``InputError`` for the first rule that a network breaks.

    The types and ranges of all fields come first, so that later checks can compute with them.
    """
    check_fields(network)
    neurons_of_all = (population.neuron for population in network.populations)
    for part in (
        *network.views,
        *network.populations,
        *network.projections,
        network.readout,
        *neurons_of_all,
    ):
        check_fields(part)
    ends: _Ends = {view.name: (view.phase, view.lines) for view in network.views}
    for population in network.populations:
        if population.name in ends:
            raise InputError(population.where, "the name is taken", fix="Rename it.")
        ends[population.name] = (population.phase, population.size)
        _check_neuron(population)
    _check_axes(network)
    for view in network.views:
        _check_view(view, network)
    _check_walks(network)
    _check_readout(network)
    if not network.projections:
        raise InputError(
            f"model {network.name!r}", "it has no weights", fix="Connect an input to a population."
        )
    neurons = {population.name: population.neuron for population in network.populations}
    for projection in network.projections:
        _check_joint(projection, ends, neurons)
        _check_values(projection, (ends[projection.target][1], ends[projection.source][1]))


def _check_walks(network: Network) -> None:
    """Refuse a location phase whose inputs take different numbers of steps, or that has no input."""
    location_phases = dict.fromkeys(p.phase for p in network.populations if p.axis == "location")
    for phase in location_phases:
        walk_steps = [
            view.steps for view in network.views if view.phase == phase and view.walk is not None
        ]
        if len(set(walk_steps)) != 1:
            steps = ", ".join(map(str, walk_steps)) or "of none"
            raise InputError(
                f"model {network.name!r}",
                f"its inputs do not give the {phase} axis one number of steps",
                measured=f"steps {steps}",
                fix="Give inputs of that axis that take equal steps.",
            )


def _check_readout(network: Network) -> None:
    """Check that the populations that are read have one size, and a weight and a step each that make sense."""
    readout = network.readout
    sizes = [
        p.size
        for name in readout.populations
        for p in network.populations
        if p.name == name and not p.helper
    ]
    weights = np.asarray(readout.weights, dtype=np.float64)
    is_complete = len(sizes) == len(readout.populations) == len(weights)
    is_finite = bool(np.isfinite(weights).all())
    if len(set(sizes)) != 1 or not is_complete or not is_finite:
        measured = f"populations {readout.populations}, sizes {sizes}, weights {readout.weights}"
        fix = "Name populations of one size, each with its weight."
        raise InputError(
            "readout", "its populations or weights do not fit together", measured=measured, fix=fix
        )
    potentials_from = readout.potentials_from
    steps = potentials_from
    if not isinstance(steps, tuple):
        steps = (steps,) * len(sizes)
    if len(steps) != len(sizes) or not all(map(_is_step_or_none, steps)):
        fix = "Give a step from 0 up, or one or None for each population."
        raise InputError(
            "readout",
            "potentials_from is not a step",
            measured=f"{potentials_from!r}"[:80],
            fix=fix,
        )
    _check_magnitude("readout", "a weight", weights[weights != 0], _LEAST)
    tie_class = readout.tie_class
    if tie_class is not None and not (type(tie_class) is int and 0 <= tie_class < sizes[0]):
        raise InputError(
            "readout",
            "tie_class is not a class",
            measured=f"{tie_class!r} against 0..{sizes[0] - 1}"[:80],
            fix="Give the number of a class, or None.",
        )
    if network.class_names is not None:
        where = f"model {network.name!r}"
        names = clean_class_names(where, network.class_names, network.classes)
        what = "its class names do not fit its classes"
        check_same(len(names), network.classes, where, what, fix="Give one for each class.")


def _is_step_or_none(step: object) -> bool:
    # type() rather than isinstance(): True and False are no steps.
    return step is None or (type(step) is int and 0 <= step <= MOST)


def _check_axes(network: Network) -> None:
    """Check that all views and populations of a phase step along one axis."""
    axes: dict[str, Axis] = {}
    parts: tuple[InputView | Population, ...] = (*network.views, *network.populations)
    for part in parts:
        if axes.setdefault(part.phase, part.axis) != part.axis:
            what = (
                f"its phase {part.phase!r} has inputs or populations of the {axes[part.phase]} axis"
            )
            raise InputError(
                part.where, what, fix=f"Give it the {axes[part.phase]} axis, or another phase."
            )


def _check_start(view: InputView, network: Network) -> None:
    """Check that the views of a phase start together, and that nothing acts before the first touch.

    Before the first touch, the chip does not step a time phase, but the float network would add its biases.
    """
    where, events = view.where, view.align_events
    if any(other.align_events != events for other in network.views if other.phase == view.phase):
        what = f"other inputs of the {view.phase} phase start elsewhere"
        raise InputError(where, what, fix="Give them the same align_events.")
    if events is None or view.axis != "time":
        return
    for population in network.populations:
        if population.phase == view.phase and population.neuron.biased.any():
            name = population.name
            what = f"it starts at the first touch, but population {name!r} has biases, which act before"
            raise InputError(where, what, fix="Train without biases, or do not align.")


def _check_view(view: InputView, network: Network) -> None:
    """Check where a view starts, and that the walk of a location view visits every channel once on lines of its own."""
    where = view.where
    _check_start(view, network)
    if view.axis == "time":
        if view.walk is not None or view.together != 1 or view.silence != 0:
            raise InputError(
                where, "only a location axis has a location order", fix="Leave it out."
            )
        return
    if (
        view.walk is None
        or view.walk.dtype.kind not in "iu"
        or sorted(view.walk.tolist()) != [*range(network.channels)]
    ):
        fix = "Visit every channel exactly once."
        raise InputError(where, "its location order is not a permutation of the channels", fix=fix)
    if view.together > network.channels or view.lines % view.together:
        what = "channels visited together do not have equal lines of their own"
        measured = f"{view.together} of {counted(network.channels, 'channel')} on {counted(view.lines, 'line')}"
        raise InputError(
            where, what, measured=measured, fix="Give lines for every time step of each."
        )


def _check_neuron(population: Population) -> None:
    """Check the shapes of a population's parameters, and that each number is one that its model allows."""
    where, neuron = population.where, population.neuron
    parameters = neuron.parameters(population.size)
    for key, values, shape, _ in parameters:
        if values.shape not in ((), shape):
            fix = "Give one number per neuron."
            raise InputError(
                where,
                f"{key} has the wrong shape",
                measured=f"{values.shape} against {shape}",
                fix=fix,
            )
    if neuron.dendrites < 1:
        raise InputError(
            where,
            "its neurons have no dendrite",
            measured=f"{neuron.dendrites}",
            fix="Give 1 or more.",
        )
    for key, values, _, must in parameters:
        if must is None:
            continue
        if values.dtype == object:  # integers beyond 64 bits
            values = values.astype(np.float64)
        values = np.atleast_1d(values)
        if must is TAPS:  # infinite taps stand for a whole kernel
            values = values[values != np.inf]
        bad = values[~(np.isfinite(values) & must.holds(values))]
        if bad.size:
            raise InputError(
                where, f"{key} must be {must.words}", measured=f"{bad.flat[0]}", fix="Correct it."
            )
        # Parameters that must be above 0 are those that something is divided by.
        _check_magnitude(where, key, values, _LEAST if must is POSITIVE else 0.0)


def _check_magnitude(where: str, key: str, values: AnyArray, least: float) -> None:
    """Refuse magnitudes outside ``least`` to :data:`_MOST`, with which the float network itself would overflow."""
    size = np.abs(values)
    bad = values[(size < least) | (size > _MOST)]
    if bad.size:
        first = bad.flat[0]
        small_or_large = "small" if abs(first) < 1 else "large"
        allowed = f"{least:g} to {_MOST:g}" if least else f"{_MOST:g}"
        raise InputError(
            where,
            f"{key} is too {small_or_large} a number to compute with",
            measured=f"{first:g} against {allowed}",
            fix="Give it in other units.",
        )


def _check_joint(
    projection: Projection | ChipProjection, ends: _Ends, neurons: Mapping[str, Neuron]
) -> None:
    """Check that source and target of a projection exist, share a phase, and that the target takes such weights."""
    where = projection.where
    if projection.target in ends and projection.target not in neurons:
        raise InputError(where, "an input takes no synapses", fix="Connect it the other way round.")
    if projection.source not in ends or projection.target not in ends:
        raise InputError(
            where, "it joins something that does not exist", fix="Name an input or a population."
        )
    source_phase, target_phase = ends[projection.source][0], ends[projection.target][0]
    if source_phase != target_phase:
        raise InputError(
            where,
            f"joins the {source_phase} axis to the {target_phase} axis",
            fix="Keep to one axis.",
        )
    neuron = neurons[projection.target]
    if projection.on_grid != neuron.on_grid:
        what = (
            "float weights reach integer neurons"
            if neuron.on_grid
            else "integer weights reach float neurons"
        )
        raise InputError(
            where, what, fix="Give a population and the weights onto it in one kind of number."
        )
    if not 0 <= projection.dendrite < neuron.dendrites:
        measured = f"{projection.dendrite} of {neuron.dendrites}, counted from 0"
        raise InputError(
            where, "the target has no such dendrite", measured=measured, fix="Name one that it has."
        )


def _check_values(projection: Projection | ChipProjection, shape: tuple[int, int]) -> None:
    """Check the weights (target size, source size) of a projection, and its delays."""
    where, weights = projection.where, projection.held
    fix = "Give one row per target and one column per source."
    check_same(weights.shape, shape, where, "the weights have the wrong shape", fix=fix)
    if not np.isfinite(values_of(weights)).all():
        raise InputError(
            where, "a weight is not a finite number", fix="Train again, with a lower learning rate."
        )
    _check_magnitude(where, "a weight", values_of(weights), 0.0)
    delay, values = np.asarray(projection.delay), values_of(weights)
    if delay.shape not in ((), values.shape):
        measured = f"{delay.shape} against {values.shape}"
        fix = "Give one delay, or one for each weight that is held."
        raise InputError(where, "the delays have the wrong shape", measured=measured, fix=fix)
    if delay.dtype.kind not in "iu" or (delay < 0).any():
        raise InputError(
            where, "a delay is not a whole number of steps from 0 up", fix="Round the delays."
        )
