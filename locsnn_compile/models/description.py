"""The description of a network without its weights: its input, its neurons and its structure, in plain values.

Training builds the network in torch from it, a checkpoint stores it, and the compiler reads it; nothing here imports
torch, so that the compiler does not need it. :class:`NetworkDescription` is the whole; the other classes are its parts.
For branches, windows and walks, see :mod:`.architectures` and :mod:`.graph_and_windows`.
"""

from collections.abc import Mapping
from itertools import product
from typing import Annotated

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.io.records import NOT_NEGATIVE, POSITIVE, Checked, between, check_value
from hw_model.values import AnyArray, Frozen, IntArray
from locsnn_compile.baselines.ann_shapes import ann_shapes
from locsnn_compile.data.orders import channel_walk, check_location_taxels
from locsnn_compile.data.recordings import MOST_STEPS, clean_class_names
from locsnn_compile.data.sensor import SensorLayout, frame_size
from locsnn_compile.errors import InputError, check_known, check_same
from locsnn_compile.models.architectures import ARCHITECTURES, Architecture
from locsnn_compile.models.graph_and_windows import (
    MAX_WINDOW_NEURONS,
    BranchGraph,
    GraphParameters,
    PlainName,
    WindowParameters,
    output_parts,
    require_rising,
)

#: Largest number of neurons of a layer: a few times what any published tactile network has.
MAX_UNITS = 4_096
#: Most events of a bin that a threshold may ask for.
MAX_THRESHOLD = 20_000_000
#: The longest delay of a synapse, in steps, that any chip file allows.
MAX_DELAY = 65_534


class InputLayout(Checked):
    """The shape of one recording: ``steps`` time steps of the channels of a ``sensor``.

    ``step_seconds`` is None if the length of a step is unknown.
    """

    sensor: SensorLayout
    steps: Annotated[int, between(1, MOST_STEPS)]
    step_seconds: Annotated[float | None, POSITIVE]
    event_threshold: Annotated[int | None, between(0, MAX_THRESHOLD)] = None
    """The number of events that a bin had to exceed to become 1; None if recordings came as bins."""

    called = "input"

    @property
    def channels(self) -> int:
        """Number of input channels of a recording."""
        return self.sensor.channels


class NeuronParameters(Checked):
    """The constants of a spike response neuron; time constants are in steps of its axis (time or locations).

    An input spike k steps ago contributes its weight times eps(k) to the potential u, an own spike nu(k):

    eps(k) = (k / tau_sr) exp(1 - k / tau_sr);
    nu(k) = -scale_ref * theta * (k / tau_ref) exp(1 - k / tau_ref); a spike where u >= theta.
    ``tau_rho`` and ``scale_rho`` shape the surrogate gradient of training only. Defaults: Kang et al. 2022.
    """

    theta: Annotated[float, POSITIVE] = 10.0
    tau_sr: Annotated[float, POSITIVE] = 10.0
    tau_ref: Annotated[float, POSITIVE] = 1.0
    scale_ref: Annotated[float, NOT_NEGATIVE] = 2.0
    tau_rho: Annotated[float, POSITIVE] = 1.0
    scale_rho: Annotated[float, POSITIVE] = 1.0

    called = "neuron"


class LifParameters(Checked):
    """The constants of a leaky integrate-and-fire neuron, over time (TLIF) or over locations (LLIF).

    u(t) = decay * u(t - 1) * (1 - o(t - 1)) + inputs; a spike where u > threshold. ``window``, in units of u, is
    half the width of the rectangle that stands for the derivative of a spike in training. Defaults: Gu et
    al. 2020, Kang et al. 2023.
    """

    decay: Annotated[float, between(0, 1)] = 0.2
    threshold: Annotated[float, POSITIVE] = 0.5
    window: Annotated[float, POSITIVE] = 0.5

    called = "neuron"

    @property
    def keep(self) -> float:
        """The share of u that a step keeps: ``decay``, but with the rounding of 1 minus the share that is lost.

        The compiler stores the share that is lost, so that both compute with the same float.
        """
        return 1.0 - (1.0 - self.decay)


class HiddenDashes(Frozen, eq=False):
    """The dashes of hidden neurons of a Xylo, (n,) each: of the current (``syn``) and of the potential (``mem``)."""

    syn: IntArray
    mem: IntArray


class XyloParameters(Checked):
    """The constants of the neurons of a Xylo.

    A *dash* is a decay as a bit shift: a step takes a share of 2^-dash from a current or a potential. Hidden neurons
    get all pairs of a ``dash_syn`` (of the synaptic current) and a ``dash_mem`` (of the membrane potential) in turn, so
    that they have different time constants; outputs have the last of each. ``window``, in thresholds, shapes the
    surrogate gradient only.
    """

    dash_syn: tuple[int, ...] = (2,)
    dash_mem: tuple[int, ...] = (4,)
    window: Annotated[float, POSITIVE] = 0.5

    called = "neuron"

    def __post_init__(self) -> None:
        super().__post_init__()
        # With dash 0, no input would ever reach a current.
        for name, least in (("dash_syn", 1), ("dash_mem", 0)):
            fix = "Give, for example, 2 4."
            what = "numbers of bits to shift by"
            require_rising(f"neuron {name!r}", getattr(self, name), least, xylo.DASH_MAX, what, fix)

    def hidden_dashes(self, size: int) -> HiddenDashes:
        """Return the dashes of ``size`` hidden neurons."""
        pairs = list(product(self.dash_syn, self.dash_mem))
        syn, mem = np.array([pairs[number % len(pairs)] for number in range(size)]).T
        return HiddenDashes(syn, mem)

    @property
    def output_dash_syn(self) -> int:
        """The dash of an output's current."""
        return self.dash_syn[-1]

    @property
    def output_dash_mem(self) -> int:
        """The dash of an output's potential."""
        return self.dash_mem[-1]


Neuron = NeuronParameters | LifParameters | XyloParameters
"""The constants that the neurons of a network may have."""


class NetworkDescription(Frozen):
    """A network without its weights.

    - ``architecture``: a name in :data:`.architectures.ARCHITECTURES`; ``name``: the network's own name
    - ``input``: the shape of recordings; ``classes``: number of classes; ``hidden``: neurons of a hidden layer
    - ``neuron``: the constants of its neurons; None stands for the published ones, if the architecture has neurons
    - ``graph``: its graph convolutions; None if it has none
    - ``location_order``: the name of the walk, which is the order in which a location branch visits the taxels, the
      touch-sensitive points of the sensor; ``location_taxels``: the walk itself, as 1-based taxel numbers of one
      fingertip. Both are None for a network without a location branch.
    - ``delays``: every channel has one synapse of each of these delays, in steps, onto each neuron of ``time_hidden``;
      ``location_delays``: the same from every time step onto ``location_hidden``, in locations
    - ``location_neuron``: the constants of the location branch, if they differ from ``neuron``
    - ``class_names``: None if the classes have no names
    - ``window``: the windows of the branch that counts in windows, if there is one
    - ``align_events``: the number of events in one step at which a recording starts; None: it starts at its first step

    The shapes of its weights are :attr:`weight_shapes`.
    """

    architecture: str
    input: InputLayout
    classes: int
    hidden: int = 32
    neuron: Neuron | None = None
    location_order: str | None = None
    location_taxels: tuple[int, ...] | None = None
    name: PlainName = "model"
    graph: GraphParameters | None = None
    delays: tuple[int, ...] = (0,)
    class_names: tuple[str, ...] | None = None
    location_neuron: Neuron | None = None
    location_delays: tuple[int, ...] = (0,)
    window: WindowParameters | None = None
    align_events: int | None = None

    def __post_init__(self) -> None:
        check_known(
            "architecture",
            f"{self.architecture!r} is not known",
            str(self.architecture),
            ARCHITECTURES,
        )
        self._check_parts()
        self._check_delays()
        if self.structure.window_branch:
            require_count("window neurons", sum(self._hidden_of_taxel), MAX_WINDOW_NEURONS)
        require_count("classes", self.classes, MAX_UNITS)
        require_count("hidden", self.hidden, MAX_UNITS)
        if self.align_events is not None:
            # A step has at most one event of each channel.
            require_count("align_events", self.align_events, self.input.channels)
            if not self.branches:
                raise self._refused(
                    "its recordings start at their first step", fix="Leave align_events out."
                )
        if self.class_names is not None:
            # Raises for names that do not print, that are repeated, or too few.
            clean_class_names("classes", self.class_names, self.classes)
            require_count("classes", len(self.class_names), self.classes)
        if "location" not in self.branches:
            if self.location_taxels is not None or self.location_order is not None:
                what = "it has no location branch, so it takes no location order"
                raise self._refused(what, fix="Leave the order out.")
        elif self.location_taxels is None or self.location_order is None:
            fix = "Give its name, such as loop or snake, or a list of taxel numbers."
            raise self._refused("its location branch needs a location order", fix=fix)
        else:
            check_location_taxels(self.location_taxels, self.input.sensor.taxels)

    def _check_parts(self) -> None:
        """Refuse a neuron, a graph or windows that do not belong to the architecture; fill in default constants."""
        kind = _NEURONS.get(self.structure.neurons)
        windows = WindowParameters if self.structure.window_branch else None
        # The class is frozen, but not yet shared with anybody.
        if self.neuron is None and kind is not None:
            object.__setattr__(self, "neuron", kind())
        if self.window is None and windows is not None:
            object.__setattr__(self, "window", windows())
        has_location_neuron = "location" in self.branches and self.location_neuron is not None
        for what, value, expected in (
            ("neuron", self.neuron, kind),
            ("location neuron", self.location_neuron, kind if has_location_neuron else None),
            ("graph", self.graph, GraphParameters if self.structure.graph else None),
            ("window", self.window, windows),
        ):
            expected_type = expected or type(None)
            if type(value) is not expected_type:
                measured = f"{type(value).__name__} against {expected_type.__name__}"
                raise self._refused(
                    f"its {what} is of another kind",
                    measured=measured,
                    fix="Correct the description.",
                )
        if self.graph is not None:
            self.graph.check(self.input.sensor.taxels)
            for branch in self.branches:
                nodes, _, features = self.graph.size(branch, self.input.sensor, self.input.steps)
                require_count(f"neurons of {branch}_graph", nodes * features, MAX_UNITS)
        if self.architecture == "cnn-3d":
            # Raises for a sensor without frames.
            frame_size(self.input.sensor)

    def _check_delays(self) -> None:
        """Refuse delays that no synapse can have, and delays without a layer for them."""
        for name, branch, steps in (
            ("delays", "time", "time steps"),
            ("location_delays", "location", "locations"),
        ):
            delays = getattr(self, name)
            require_rising(
                name,
                delays,
                least=0,
                most=MAX_DELAY,
                what="whole numbers of steps",
                fix="Give, for example, 0 20 40 60.",
            )
            # Neurons that count in windows receive from all steps at once, and a Xylo has no delays.
            dense = (
                branch in self.branches
                and not self.structure.graph
                and self.structure.neurons not in ("windows", "xylo")
            )
            if delays != (0,) and not dense:
                what = f"it has no fully connected layer over {steps}, so it takes no delays"
                raise self._refused(what, fix="Leave the delays out.")

    def _refused(self, what: str, *, measured: str = "", fix: str) -> InputError:
        """Return the error for a field that does not go with the architecture."""
        return InputError(f"architecture {self.architecture!r}", what, measured=measured, fix=fix)

    @property
    def structure(self) -> Architecture:
        """The structure of a network of this architecture."""
        return ARCHITECTURES[self.architecture]

    @property
    def walk(self) -> IntArray:
        """Position -> channel of the location branch, (channels,); ``InputError`` if there is none."""
        return channel_walk(self.location_taxels or (), self.input.sensor)

    @property
    def branches(self) -> tuple[str, ...]:
        """The branches of the network: ``time``, ``location``, ``window``; none of an artificial network."""
        return self.structure.branches

    def neuron_of(self, name: str) -> Neuron | None:
        """Return the constants of the neurons of a branch or of a population, by its name."""
        if name.startswith("location") and self.location_neuron is not None:
            return self.location_neuron
        return self.neuron

    def delays_onto(self, population: str) -> tuple[int, ...]:
        """Return the delays of the synapses onto a population, in steps of its axis."""
        delays = {"time_hidden": self.delays, "location_hidden": self.location_delays}
        return delays.get(population, (0,))

    def srm(self, name: str) -> NeuronParameters:
        """Return :meth:`neuron_of` for a network of spike response neurons; ``InputError`` for other networks."""
        neuron = self.neuron_of(name)
        if not isinstance(neuron, NeuronParameters):
            # Whoever asks wants to train on a chip's integers, which networks of windows can do as well.
            architectures = (
                name
                for name, structure in ARCHITECTURES.items()
                if structure.neurons in ("srm", "windows")
            )
            raise self._refused(
                "it has no spike response neurons", fix=f"Use one of: {', '.join(architectures)}."
            )
        return neuron

    @property
    def xylo_neuron(self) -> XyloParameters:
        """The neuron of a network that has those of a Xylo."""
        assert isinstance(self.neuron, XyloParameters)
        return self.neuron

    @property
    def windows(self) -> WindowParameters:
        """The windows of a network that has a branch of them."""
        assert self.window is not None
        return self.window

    @property
    def window_names(self) -> tuple[str, str]:
        """The names of the weights (classes, hidden neurons) and the bias (classes,) of the output of windows."""
        output = f"{self.structure.window_branch}_output"
        return output, f"{output}_bias"

    @property
    def _hidden_of_taxel(self) -> list[int]:
        """For each taxel of the walk, on all surfaces, the number of hidden neurons that count its events."""
        sensor = self.input.sensor
        return [sensor.polarities * self.windows.of_channel(self.input.steps)] * (
            sensor.surfaces * sensor.taxels
        )

    @property
    def output_parts(self) -> list[slice]:
        """The slices of hidden neurons of windows from which each output population receives."""
        return output_parts(self._hidden_of_taxel)

    def populations(self, branch: str) -> tuple[str, ...]:
        """Return the names of a branch's populations, in evaluation order; the last one is the output.

        A branch of windows has as many output populations as it takes to receive from all of its hidden neurons; their
        potentials are added.
        """
        if branch == self.structure.window_branch:
            return f"{branch}_hidden", *(
                f"{branch}_output_{1 + i}" for i in range(len(self.output_parts))
            )
        layers = (
            ("graph", "hidden", "hidden_2", "output")
            if self.structure.graph
            else ("hidden", "output")
        )
        return tuple(f"{branch}_{layer}" for layer in layers)

    def graph_of(self, branch: str) -> BranchGraph:
        """Return the graph of a branch of a network that has graph convolutions."""
        assert self.graph is not None
        return self.graph.of_branch(branch, self.input.sensor, self.input.steps)

    @property
    def weight_shapes(self) -> dict[str, tuple[int, ...]]:
        """Population name -> (out, in) of the weights into it, in evaluation order.

        The inputs of a branch's first population are its lines with the first delay, then with the next, and so on. For
        a graph convolution, the shape is (features, (hops + 1) * inputs per node). For an artificial network, these are
        the shapes of its parameters by name.
        """
        if not self.structure.spiking:
            return ann_shapes(
                self.architecture,
                sensor=self.input.sensor,
                steps=self.input.steps,
                classes=self.classes,
                hidden=self.hidden,
            )
        shapes: dict[str, tuple[int, ...]] = {}
        sizes: tuple[tuple[int, ...], ...]
        for branch in self.branches:
            if branch == self.structure.window_branch:
                sizes = (self.classes, sum(self._hidden_of_taxel)), (self.classes,)
                shapes |= zip(self.window_names, sizes, strict=True)
                continue
            names, hidden = self.populations(branch), self.hidden
            if self.graph is None:
                lines = self.input.channels if branch == "time" else self.input.steps
                sizes = (hidden, lines * len(self.delays_onto(names[0]))), (self.classes, hidden)
                if self.structure.neurons == "xylo":
                    names = (names[0], f"{branch}_recurrent", names[1])
                    sizes = (sizes[0], (hidden, hidden), sizes[1])
            else:
                nodes, inputs, features = self.graph.size(
                    branch, self.input.sensor, self.input.steps
                )
                # As in TactileSGNet, the second hidden layer has twice as many neurons as the first.
                sizes = (
                    (features, (self.graph.hops + 1) * inputs),
                    (hidden, nodes * features),
                    (2 * hidden, hidden),
                    (self.classes, 2 * hidden),
                )
            shapes |= zip(names, sizes, strict=True)
        return shapes

    def check_shape(self, name: str, weights: Mapping[str, AnyArray], fix: str) -> None:
        """Raise ``InputError`` if ``weights`` lacks a name, or has another shape for it; ``fix`` says what to do."""
        expected_shape = self.weight_shapes[name]
        shape = tuple(weights[name].shape) if name in weights else "none"
        what = "its weights do not fit the network"
        check_same(shape, expected_shape, f"population {name!r}", what, fix=fix)


def require_count(where: str, value: int, limit: int) -> None:
    """Raise ``InputError`` unless a value is a whole number from 1 to ``limit``."""
    check_value(where, value, (int,), (between(1, limit),))


_NEURONS: dict[str, type[Neuron]] = {
    "srm": NeuronParameters,
    "lif": LifParameters,
    "xylo": XyloParameters,
}
"""``Architecture.neurons`` -> the class of their constants; windows and artificial networks have none."""
