"""The first level of the compiler: a trained network as its author thinks of it.

Frontends make a :class:`Network` from a file, and each pass turns one level into the next:

Network -> QuantizedNetwork -> CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)  quantize       lower_neurons      place_cores    route_axons    assemble

A network consists of *views*, which feed recordings to input lines, *populations* of neurons, *projections* (weights)
between them, and a readout. Neurons and weights are in float, or already in the chip's integers (*on the grid*).
Time neurons step over time, location neurons over the channels of a recording; a *phase* is one run over such an axis.
"""

import math
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Annotated, Any

import numpy as np

from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, between
from hw_model.mapping.graph import AXES, MAX_LINES, MAX_STEPS, Axis, Phase
from hw_model.mapping.graph import Readout as Readout
from hw_model.mapping.recorded import RecordedChannels
from hw_model.values import ByteArray, FloatArray, Frozen, IntArray, Shown
from locsnn_compile.data.channels import Channels, Numbering
from locsnn_compile.data.recordings import STEP_SECONDS, EventTimes, Expected, Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError, check_most, counted, listed
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.first_touch import from_first_touch
from locsnn_compile.network.input_scaling import InputScaling
from locsnn_compile.network.neurons import Neuron, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection

MOST = min(MAX_LINES, MAX_STEPS)
"""Lines, neurons of a population, and steps that a network may have: as many as a program."""


class InputView(Shown):
    """``lines`` input lines of one axis, which play a recording (steps, channels) as spikes.

    On the time axis, line c spikes at step t if channel c does. On the location axis, time and channels swap roles:
    neurons step over channels in the order of the ``walk``, ``together`` channels per step, and each time step has its
    own line. Channel ``walk[i]`` is visited at step ``i // together``, and in that step its event at time step t spikes
    on line ``(i % together) * (lines // together) + t``. ``silence`` steps without events follow the walk, so that the
    last events can pass through all layers.

    With ``align_events``, a recording starts at its first step with at least that many events; if there is no such
    step, nothing is played. On the time axis, the neurons step from there on; on the location axis, that step is time
    step 0.
    """

    name: str
    axis: Axis
    lines: Annotated[int, between(1, MOST)]
    walk: IntArray | None = None
    together: Annotated[int, between(1, MOST)] = 1
    silence: Annotated[int, between(0, MOST)] = 0
    own_phase: str = ""
    """The phase in which it is played, if that is not the phase of its axis."""
    align_events: Annotated[int | None, AT_LEAST_ONE] = None
    """Events in one step at which a recording starts; None: it starts at its first step."""

    @property
    def where(self) -> str:
        """How errors name it."""
        return f"input {self.name!r}"

    @property
    def phase(self) -> str:
        """The phase in which it is played."""
        return self.own_phase or self.axis

    @property
    def steps(self) -> int:
        """Steps of a walk over the location axis, including the silence after it."""
        assert self.walk is not None
        return -(-len(self.walk) // self.together) + self.silence

    @property
    def positions(self) -> IntArray | None:
        """The inverse of the walk: the step at which each channel is visited, (channels,)."""
        if self.walk is None:
            return None
        # The argsort of a permutation is its inverse.
        place_in_walk = np.argsort(self.walk).astype(np.int64)
        return place_in_walk // self.together

    @property
    def first_lines(self) -> IntArray | None:
        """The line of time step 0 of each channel, (channels,); None if one channel is visited at a time."""
        if self.walk is None or self.together == 1:
            return None
        place_in_walk = np.argsort(self.walk).astype(np.int64)
        lines_per_channel = self.lines // self.together
        return place_in_walk % self.together * lines_per_channel

    def play(self, recordings: ByteArray) -> ByteArray:
        """Return the spikes of the lines, (batch, steps, lines), for recordings (batch, time steps, channels)."""
        if self.align_events is not None:
            recordings = from_first_touch(
                recordings, self.align_events, moved=self.walk is not None
            )
        if self.walk is None:
            return recordings
        time_steps = self.lines // self.together
        # Transpose to (batch, channels in walk order, time steps).
        visits = recordings[:, :time_steps, self.walk].transpose(0, 2, 1)
        if visits.shape[1:] == (self.steps, self.lines):
            return visits
        # Short recordings, the last step of the walk, and the silence after it are padded with zeros.
        batch, channels, recorded_steps = visits.shape
        played = np.zeros((batch, self.steps * self.together, time_steps), dtype=np.uint8)
        played[:, :channels, :recorded_steps] = visits
        return played.reshape(batch, self.steps, self.lines)


class Population(Shown):
    """``size`` neurons of one model, which step along one axis."""

    name: str
    axis: Axis
    size: Annotated[int, between(1, MOST)]
    neuron: Neuron
    helper: bool = False
    """Whether a frontend added it: its neurons are not in the model, and they are not compared."""
    own_phase: str = ""
    """The phase in which it runs, if that is not the phase of its axis."""

    @property
    def where(self) -> str:
        """How errors name it."""
        return f"population {self.name!r}"

    @property
    def phase(self) -> str:
        """The phase in which it runs."""
        return self.own_phase or self.axis

    @property
    def on_grid(self) -> bool:
        """Whether its parameters and incoming weights are already the chip's integers."""
        return self.neuron.on_grid

    @property
    def thresholds(self) -> FloatArray:
        """The threshold of each neuron in the units of its potential, (n,)."""
        return np.broadcast_to(np.asarray(self.neuron.spikes_at, dtype=np.float64), (self.size,))


class Member(Frozen):
    """A network in a committee: its name, the sha256 of its file, and the weight of its class scores."""

    name: str
    sha256: str
    weight: float


class Network(Shown):
    """A trained network: views of one recording, populations, projections and a readout.

    :func:`load` reads a network from a file. To make one by hand, give its parts, with numpy arrays for weights.
    """

    name: str
    channels: Annotated[int, between(1, MOST)]
    steps: Annotated[int, between(1, MOST)]
    """Time steps of a recording; shorter recordings are padded with silence."""
    views: tuple[InputView, ...]
    populations: tuple[Population, ...]
    projections: tuple[Projection | ChipProjection, ...]
    readout: Readout
    step_seconds: Annotated[float | None, STEP_SECONDS] = None
    """Seconds per time step; None if neither its file nor the user fixes it."""
    sensor: SensorLayout | None = None
    """The layout of its channels, if its file has one."""
    sha256: str = ""
    """The hash of the file that the network was read from; empty if it was made by hand."""
    recordings: Recordings | None = None
    """A few recordings that the file carries for checks."""
    origin: object | None = None
    """The content of its file, kept so that an emitter can write the file again; None if no emitter needs it."""
    any_length: bool = False
    """Whether recordings of any length are played as they are; ``steps`` is then only the usual number."""
    assumptions: tuple[str, ...] = ()
    """Assumptions that were needed to read its file, as sentences."""
    event_threshold: Annotated[int | None, NOT_NEGATIVE] = None
    """The number of events that a bin has to exceed to become 1; None if unknown."""
    class_names: tuple[str, ...] | None = None
    """The names of its classes, if they have names."""
    psi: Annotated[float | None, NOT_NEGATIVE] = None
    """How late its time-weighted prediction turns to the location branch; None if unknown.

    The location branch has the share ``1 / (1 + exp(-psi * (t / T - 1)))`` of the class scores after step t of T."""
    trained_on: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """For a network trained in integers: the bits of the charge, current and voltage registers that it was trained
    with, by the name of the chip."""
    usual_step_seconds: Annotated[float | None, STEP_SECONDS] = None
    """Seconds per time step as its file states them, if neither recordings nor the user say otherwise."""
    members: tuple[Member, ...] = ()
    """The networks of a committee, whose populations begin with ``name/``."""
    inputs: Channels | None = None
    """The pixels that its channels stand for, if its file gives them by other means than a ``sensor``."""
    channel_order: Numbering | None = None
    """How its channels are numbered, if the user states it because the file does not."""
    event_times: EventTimes | None = None
    """How the events that it was trained on were timed, if its file states it."""
    recorded: RecordedChannels | None = None
    """The sensor that it was trained on, where its channels are some of the sensor's, or merged."""
    host: "HostLayers | None" = None
    """The layers before it that run on the host, whose spikes are its recordings; None if there are none."""

    def population(self, name: str) -> Population:
        """Return a population by name."""
        return next(population for population in self.populations if population.name == name)

    @property
    def own_populations(self) -> tuple[Population, ...]:
        """The populations of the model itself, without those that a frontend added."""
        return tuple(population for population in self.populations if not population.helper)

    @property
    def by_strategy(self) -> bool:
        """Whether there are neurons (spike response neurons) that a strategy turns into compartments."""
        return any(population.neuron.by_strategy for population in self.populations)

    @property
    def cuts_kernels(self) -> bool:
        """Whether it has kernels that are cut off before their tails fade; the chip keeps the tails."""
        kernels = (p.neuron for p in self.populations if isinstance(p.neuron, SrmAlpha))
        return any(min(kernel.eps_taps, kernel.nu_taps) < math.inf for kernel in kernels)

    @property
    def has_float_weights(self) -> bool:
        """Whether there are weights to round; on-grid weights are kept as they are."""
        return any(not population.on_grid for population in self.populations)

    @property
    def has_both_axes(self) -> bool:
        """Whether there are a time and a location branch, which time-weighted predictions need."""
        return len({population.axis for population in self.populations}) == len(AXES)

    @property
    def phases(self) -> tuple[Phase, ...]:
        """One phase for each axis and each way to play the recording along it; time phases come first."""
        axis_of = {population.phase: population.axis for population in self.populations}
        starts = {view.phase: view.align_events for view in self.views}
        rows = sorted(axis_of.items(), key=lambda row: AXES.index(row[1]))
        return tuple(
            Phase(name, axis, self.steps_of(name), starts.get(name)) for name, axis in rows
        )

    @property
    def expected(self) -> Expected:
        """What the network expects of recordings."""
        return Expected(
            whose=f"model {self.name!r}",
            step_seconds=self.step_seconds,
            threshold=self.event_threshold,
            steps=None if self.any_length else self.steps,
            channels=self.channels,
            class_names=self.class_names,
            inputs=self.known_inputs,
            numbering=self.numbering,
            usual_step_seconds=self.usual_step_seconds,
            event_times=self.event_times or EventTimes(),
            recorded=self.recorded,
        )

    @property
    def stated_step_seconds(self) -> float | None:
        """Seconds per time step, for when no recordings state them."""
        return self.usual_step_seconds if self.step_seconds is None else self.step_seconds

    def with_steps_of(self, recordings: Recordings) -> "Network":
        """Return the network with the steps of these recordings, where it leaves the steps open.

        Its file may state only a usual length of a step, or take recordings of any number of steps.
        """
        network = self
        if self.step_seconds is None and self.usual_step_seconds is not None:
            step_seconds = recordings.step_seconds or self.usual_step_seconds
            network = replace(network, step_seconds=step_seconds)
        if self.any_length:
            network = replace(network, steps=recordings.spikes.shape[1])
        return network

    @property
    def known_inputs(self) -> Channels | None:
        """The pixels that its channels stand for, from its file or its sensor; None if unknown."""
        if self.inputs is None and self.sensor is not None:
            return self.sensor.inputs
        return self.inputs

    @property
    def numbering(self) -> Numbering | None:
        """How its channels are numbered; None if neither its file nor its user states it."""
        if self.known_inputs is not None:
            return self.known_inputs.numbering
        # Sensor layouts number the polarities of a taxel next to each other: channel = polarities * taxel + polarity.
        return "yxp" if self.sensor is not None else self.channel_order

    @property
    def numbering_entries(self) -> dict[str, Any]:
        """The entries of a program that describe its channels: numbering, polarities and columns."""
        entries: dict[str, Any] = {"channel_order": self.numbering}
        inputs = self.known_inputs
        if inputs is not None:
            entries["polarities"] = inputs.polarities
            entries["columns"] = inputs.columns if inputs.is_grid else None
        if self.recorded is not None:
            entries["recorded"] = self.recorded
        return entries

    def steps_of(self, phase: str) -> int:
        """Return the steps of a phase: time steps, or the steps of its walks over the channels."""
        # All walks of a phase have equal steps: network.check refuses others.
        walks = (view.steps for view in self.views if view.phase == phase and view.walk is not None)
        return next(walks, self.steps)

    def into(self, name: str) -> tuple[Projection | ChipProjection, ...]:
        """Return the projections onto a population."""
        return tuple(projection for projection in self.projections if projection.target == name)

    @property
    def classes(self) -> int:
        """The number of classes: each neuron of a population that is read out stands for one."""
        return next(p.size for p in self.populations if p.name == self.readout.populations[0])

    def fitted(self, recordings: Recordings) -> Recordings:
        """Return recordings padded to the network's steps by :meth:`fit`; the same object if none is padded."""
        spikes = self.fit(recordings.spikes, recordings.source)
        return recordings if spikes is recordings.spikes else replace(recordings, spikes=spikes)

    def fit(self, recordings: ByteArray, source: str) -> ByteArray:
        """Check channels and steps; pad shorter recordings with silence, and refuse longer ones.

        For a network of ``any_length``, recordings are returned unpadded.
        """
        where = f"events {source!r}"
        if recordings.ndim != 3 or recordings.shape[2] != self.channels:
            measured = f"{counted(recordings.shape[-1], 'channel')} against {self.channels}"
            fix = f"Give recordings of {counted(self.channels, 'channel')}."
            raise InputError(
                where, "the channel count differs from the model's", measured=measured, fix=fix
            )
        if self.any_length:
            return recordings
        recorded_steps = recordings.shape[1]
        check_most(
            recorded_steps,
            self.steps,
            where,
            "the recordings are longer than the model's",
            unit="steps",
            fix=f"Cut them to {counted(self.steps, 'step')}.",
        )
        if recorded_steps == self.steps:
            return recordings
        return np.pad(recordings, ((0, 0), (0, self.steps - recorded_steps), (0, 0)))


class HostOutput(Frozen):
    """A population on the host whose spikes the host sends to the chip, ``depth`` steps earlier than it fires.

    In our reference, each layer fires one step after its input. If that is so in the network's own framework as well,
    ``depth`` is 0. Otherwise it is the number of layers to make up for, so that spikes are sent in the step of the
    numbers that cause them.
    """

    population: str
    depth: int


class HostLayers(Shown):
    """The first layers of a network, which run on the host and send spikes to the chip.

    - ``network``: the layers; its input takes numbers in place of spikes
    - ``sends``: the populations whose spikes are sent, in the order of the chip's input lines
    - ``input_shape``: the shape of the numbers of one step, such as (channels, height, width)
    - ``scaling``: how the numbers are scaled before the first layer; None if they are not
    """

    network: Network
    sends: tuple[HostOutput, ...]
    input_shape: tuple[int, ...]
    scaling: InputScaling | None = None

    @property
    def lines(self) -> int:
        """The number of input lines of the chip that the host feeds."""
        return sum(self.network.population(sent.population).size for sent in self.sends)

    @property
    def depth(self) -> int:
        """The largest number of steps by which spikes are sent earlier than they fire."""
        return max(sent.depth for sent in self.sends)

    @property
    def multiplications(self) -> dict[str, int]:
        """The number of multiplications by weights per step, by population; biases are additions."""
        # Biases can be the weights of helper neurons, which spike in every step.
        helpers = {population.name for population in self.network.populations if population.helper}
        products = {population.name: 0 for population in self.network.own_populations}
        for projection in self.network.projections:
            if projection.target in products and projection.source not in helpers:
                products[projection.target] += int(projection.fan_out.sum())
        return products

    @property
    def arithmetic(self) -> str:
        """The kinds of numbers it computes with, as words of a report; integer neurons take input in float."""
        neurons = [population.neuron for population in self.network.populations]
        has_integers = any(isinstance(neuron, ChipNeuron) for neuron in neurons)
        return "float and integers" if has_integers else "float"

    @property
    def sentence(self) -> str:
        """What the host does, for the assumptions of a report."""
        names = listed([repr(name) for name in self.multiplications])
        products = sum(self.multiplications.values())
        return (
            f"Layers {names} run in {self.arithmetic} on the host (--host-layers): their {products} "
            "multiplications a step are not among the chip's operations, energy and time."
        )
