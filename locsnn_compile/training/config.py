"""All options of a training run, in one frozen value that a YAML file can hold.

:class:`TrainingConfig` has a field per option. The annotation of a field holds what is checked about it: the range or
the choices of its values, and any number of :class:`Need`, the conditions under which the option has an effect. An
option that would change nothing is refused when a user gives it.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from hw_model.arithmetic.fixed_point import WEIGHT_BITS
from hw_model.io.records import Checked, RecordReader, between, said_of
from hw_model.io.yaml_text import read_mapping
from hw_model.targets.families import XYLOS, family_of
from hw_model.values import Frozen, Shown
from locsnn_compile.data.event_stream import TIME_UNITS
from locsnn_compile.data.recordings import MOST_STEPS
from locsnn_compile.data.selection import asked_selection, selected_layout
from locsnn_compile.data.sensor import MAX_CHANNELS, POLARITIES, SensorLayout, asked_layout
from locsnn_compile.data.taxel_graph import GRAPHS
from locsnn_compile.errors import InputError
from locsnn_compile.models.architectures import ARCHITECTURES, Architecture
from locsnn_compile.settings import TRAINABLE

SHARE = between(0.0, 1.0)
STEPS = between(0, 20_000)
"""The range of options that count steps."""

USUAL: dict[str, dict[str, Any]] = {
    "tactile-sgnet": {"hidden": 128},
    "hybrid-graph": {"hidden": 128},
    "gru-mlp": {"count_scale": 1.0},
    "cnn-3d": {"count_scale": 1.0},
    "xylo-snn": {
        "initial_scale": 1.0,
        "weight_decay": 0.01,
        "hidden": 64,
        "dash_mem": "3 5",
        "learning_rate": 0.004,
        "spike_cost": 0.001,
        "event_dropout": 0.2,
        "channel_dropout": 0.0,
    },
    "window-snn": {
        "count_scale": 1.0,
        "optimizer": "sgd",
        "learning_rate": 0.005,
        "weight_decay": 0.0001,
    },
}
"""Network -> options whose default is not that of :class:`TrainingConfig`."""

XYLO_MODEL = "xylo-snn"
"""The network that is trained for a Xylo, and for no other chip."""

LOCATION_CONSTANTS = {"srm": ("theta", "tau_sr", "tau_ref"), "lif": ("decay", "threshold")}
"""Kind of neuron -> constants that may differ in a location branch, as options ``location_...``."""


class EpochRecord(Frozen):
    """The figures of one epoch.

    ``phase`` is ``select`` (training on a part, validation on the rest) or ``refit`` (training afresh on everything);
    ``epoch`` counts from 1 within the phase. ``loss`` is the mean training loss; the validation figures are None
    without validation.
    """

    phase: str
    epoch: int
    learning_rate: float
    loss: float
    validation_loss: float | None
    validation_accuracy: float | None


Progress = Callable[[int, int, EpochRecord], None]
"""Called after every epoch with (epochs done in all phases, total number as far as known, the epoch's record)."""


class Need(NamedTuple):
    """The condition under which an option has an effect.

    - ``counts``: whether it has one, given the configuration and the structure of its network
    - ``why``, ``fix``: for the error if it has none
    """

    counts: "Callable[[TrainingConfig, Architecture], bool]"
    why: str
    fix: str = "Leave it out."


# In the conditions below, c is the configuration and a the structure of its network.
CHIP = Need(
    lambda c, _: c.target != "float",
    "the network is trained in float, and no chip holds it",
    "Add --target CHIP.",
)
RESETS = Need(
    lambda c, _: c.strategy == "reset", "only strategy reset has it", "Add strategy reset."
)
LOCATION = Need(lambda _, a: "location" in a.branches, "the network has no location branch")
BRANCHES = Need(lambda _, a: len(a.branches) > 1, "the network has no second branch")
SPIKING = Need(lambda _, a: a.branches != (), "the network reads recordings from their first step")
LEARNED = Need(lambda _, a: a.neurons != "windows", "events and windows decide the hidden neurons")
GRAPH = Need(
    lambda _, a: a.graph,
    "the network has no graph",
    "Choose a model with one, such as hybrid-graph.",
)
SRM = Need(lambda _, a: a.neurons == "srm", "the network has no spike response neurons")
LIF = Need(lambda _, a: a.neurons == "lif", "it has no integrate-and-fire neurons")
LEAKY = Need(lambda _, a: a.neurons in ("lif", "xylo"), "it has no integrate-and-fire neurons")
OF_XYLO = Need(
    lambda _, a: a.neurons == "xylo",
    "only neurons of a Xylo have it",
    "Add --target xylo-audio3, or another Xylo.",
)
WINDOWS = Need(
    lambda _, a: a.window_branch != "", "the network has no windows", "Choose the model window-snn."
)
SPIKE_COUNT = Need(
    lambda c, _: c.loss == "spike-count",
    "the loss is cross-entropy, which has no target",
    "Add --loss spike-count.",
)
CROSS_ENTROPY = Need(
    lambda c, _: c.loss == "cross-entropy",
    "the loss is spike-count, which takes counts as they are",
)
CLASS_ORDER = Need(
    lambda c, _: c.class_order != "",
    "nothing says which classes are neighbours",
    "Add class_order, such as '0-4 5-9'.",
)
NEIGHBOURS = Need(
    lambda c, _: c.neighbour_smoothing > 0, "neighbours get no share", "Add neighbour_smoothing."
)


class TrainingConfig(Shown, Checked, eq=True):
    """A training run, except for its data.

    For branches (time, location, window), see :mod:`locsnn_compile.models.architectures`; a taxel is one
    touch-sensitive point of the sensor, with one or two polarities, each of which is a channel.

    - ``location_weight``: the factor lambda of the location branch's scores in the loss. ``branch_loss``: this share of
      the loss is the mean of the losses of the single branches. ``loss`` spike-count uses ``target_right`` and
      ``target_wrong`` (spikes per recording); cross-entropy uses ``count_scale``, ``label_smoothing``, and
      ``neighbour_smoothing`` with ``class_order``: see :mod:`locsnn_compile.training.measure`.
    - ``class_weights`` balanced: recordings of rare classes weigh more in the loss, so that all classes count alike.
    - Augmentation, drawn anew for every recording of a batch. ``event_dropout``: the recording loses each event with a
      probability drawn from 0 to this. ``channel_dropout``: the same for channels with all their events;
      ``taxel_dropout``: for taxels with both polarities. ``event_noise``: the recording gains events with a probability
      drawn in the same way, wherever it has none. ``mixing``: with such a probability, a taxel comes from another
      recording of the class. ``time_stretch``: times are multiplied by a factor from 1 minus this to 1 plus this.
      ``cut_end``: the recording ends after a share of its steps drawn from 1 minus this to 1. ``time_shift``: the
      recording moves by up to this number of steps to either side; ``taxel_shift``: each taxel moves by itself.
    - ``weight_average``: measure and keep a running average of the weights, which retains this share of itself at every
      step; 0 keeps the weights of the last step.
    - ``initial_scale``: weights start uniform within +-this / sqrt(inputs of their layer).
    - ``validation_fraction``: this share of each class of the train part is used to choose the epoch; 0 takes the last
      epoch. Accuracies are first averaged over ``smoothing_epochs``, because with a few dozen validation recordings the
      figure of a single epoch is noisy; see :func:`locsnn_compile.training.schedule.choose_epoch`.
    - ``refit``: once the epoch is chosen, train again from the start on the whole train part, for that many epochs and
      on a schedule of that length.
    - ``defaults``: whether options that are not given are chosen from the ``data`` (see
      :mod:`locsnn_compile.training.chosen`) or have the ``fixed`` defaults of this class and of :data:`USUAL`.
    - ``device``: where matrix products run; the steps of spiking layers run on the processor.
    - ``step_seconds``: width of a time bin, if the data do not contain it (None: 0.02 s for single events, unknown for
      bins). ``event_threshold``: a bin with more single events is 1 (None: 0). ``steps``: shorter recordings are padded
      with silence, longer ones are cut (None: the length of the longest). ``psi``: the rate at which the
      prediction while a recording still plays turns from the time branch to the location branch, see
      :mod:`hw_model.streaming.psi`; training does not use it, the checkpoint stores it (None: not stated).
    - The sensor, by default NeuTouch: ``grid`` (columns x rows, such as 16x16), ``channels`` (with ``columns`` if they
      are those of a grid) or ``layout`` (a YAML file), with ``polarities`` (default: 2 for a grid, 1 for channels); see
      :class:`locsnn_compile.data.sensor.SensorLayout`. ``only_taxels``, ``only_polarity``, ``merge_polarities`` and
      ``merge_channels`` select what the network gets of it: see
      :class:`hw_model.mapping.recorded.ChannelSelection`. ``axes``: the order of the axes of arrays, if it is not
      that of files.
    - ``align_events``: recordings start at the first step with at least this many events (None: at their first step).
      ``split``: the share of every class to test on, if recordings have no parts; ``fold``: its round, or the round of
      files of rows (None: 1). ``classes``: the names of classes from class 0 on, separated by commas.
    - Of single events, ``start_at``: the seconds at which step 0 begins, or ``first`` (None: as the format has it);
      ``time_unit`` of times: ns, us, ms or s. ``max_steps``: longer recordings are refused (None: 20,000).
    - ``dash_syn`` and ``dash_mem``, separated by spaces, belong to neurons of a Xylo: see
      :class:`locsnn_compile.models.description.XyloParameters`, which also has a ``window``.
    - Time constants are in steps. ``theta`` to ``scale_rho`` belong to spike response neurons; ``decay``, ``threshold``
      and ``window`` to integrate-and-fire neurons. ``location_theta`` to ``location_threshold`` are for the location
      branch, if given; its steps are locations.
    - ``delays``: delays of the synapses from the recording onto the time branch, in steps, separated by spaces: a
      neuron has one synapse of every delay from every channel. ``location_delays``: the same for the location branch,
      in locations.
    - ``hidden``: neurons of a hidden layer. In networks with a graph, they are those of the first one, and the second
      has twice as many. ``graph`` joins the taxels (``neighbours`` and ``nearer_mm``: see
      :func:`locsnn_compile.data.taxel_graph.taxel_graph`); ``hops``, ``features`` and ``step_features``: see
      :class:`locsnn_compile.models.graph_and_windows.GraphParameters`.
    - ``window_steps``, ``window_stride`` and ``window_levels`` (numbers of events, separated by spaces): see
      :class:`locsnn_compile.models.graph_and_windows.WindowParameters`.
    - ``optimizer``: sgd has a momentum of 0.9. ``prototypes`` computes the output of ``window-snn`` from the recordings
      of all epochs, without gradient descent, with ``weight_decay`` as smoothing: see
      :func:`locsnn_compile.training.prototypes.set_prototypes`.
    - ``target``: ``float``, or the chip whose integers the forward pass computes; there neurons are laid out by
      ``strategy``, weights have ``weight_bits``, and their range is ``weight_room`` times the largest weight of the
      network that the run starts from (from scratch: :data:`locsnn_compile.training.target.USUAL_LARGEST`).
      ``refractory`` is the chip's count, for strategy ``reset``.
    - ``tie``: the class, by name or number, that is predicted where the scores of all classes are equal, as in silence;
      checkpoint and program keep it (None: such a recording predicts no class and counts as wrong).
    - ``pruned``: this share of each population's weights, the smallest ones at the start, are set to 0 and stay 0.
    - ``spike_cost``: added to the loss for every spike of a hidden neuron, averaged over neurons and recordings.
    """

    model: Annotated[str, tuple(ARCHITECTURES)] = "hybrid"
    order: Annotated[str, LOCATION] = "loop"
    delays: str = "0"
    location_delays: Annotated[str, LOCATION] = "0"
    hidden: Annotated[int, between(1, 4096), LEARNED] = 32
    loss: Annotated[str, ("cross-entropy", "spike-count")] = "cross-entropy"
    location_weight: Annotated[float, between(0.0, 1e3), BRANCHES] = 1.0
    branch_loss: Annotated[float, SHARE, BRANCHES] = 0.0
    target_right: Annotated[float, between(0.0, 1e6), SPIKE_COUNT] = 60.0
    target_wrong: Annotated[float, between(0.0, 1e6), SPIKE_COUNT] = 3.0
    count_scale: Annotated[float, between(1e-6, 1e3), CROSS_ENTROPY] = 0.1
    class_weights: Annotated[str, ("equal", "balanced")] = "equal"
    label_smoothing: Annotated[float, between(0.0, 0.999), CROSS_ENTROPY] = 0.05
    neighbour_smoothing: Annotated[float, between(0.0, 0.5), CROSS_ENTROPY, CLASS_ORDER] = 0.0
    class_order: Annotated[str, CROSS_ENTROPY, NEIGHBOURS] = ""
    optimizer: Annotated[str, ("adamw", "rmsprop", "sgd", "prototypes")] = "adamw"
    schedule: Annotated[str, ("cosine", "constant")] = "cosine"
    learning_rate: Annotated[float, between(1e-9, 1e3)] = 0.003
    weight_decay: Annotated[float, between(0.0, 1e3)] = 0.1
    epochs: Annotated[int, between(1, 100_000)] = 250
    batch_size: Annotated[int, between(1, 100_000)] = 16
    initial_scale: Annotated[float, between(1e-3, 1e3)] = 3.0
    event_dropout: Annotated[float, SHARE] = 0.5
    channel_dropout: Annotated[float, SHARE] = 0.3
    taxel_dropout: Annotated[float, SHARE] = 0.0
    event_noise: Annotated[float, SHARE] = 0.0
    mixing: Annotated[float, SHARE] = 0.0
    cut_end: Annotated[float, SHARE] = 0.0
    time_stretch: Annotated[float, between(0.0, 0.9)] = 0.0
    time_shift: Annotated[int, STEPS] = 0
    taxel_shift: Annotated[int, STEPS] = 0
    weight_average: Annotated[float, between(0.0, 0.99999)] = 0.0
    validation_fraction: Annotated[float, between(0.0, 0.9)] = 0.125
    smoothing_epochs: Annotated[int, between(1, 1_000)] = 10
    refit: bool = True
    seed: Annotated[int, between(0, 2**32 - 1)] = 0
    defaults: Annotated[str, ("data", "fixed")] = "data"
    device: Annotated[str, ("cpu", "cuda")] = "cpu"
    step_seconds: Annotated[float | None, between(1e-6, 1e3)] = None
    steps: Annotated[int | None, between(1, MOST_STEPS)] = None
    event_threshold: Annotated[int | None, between(0, 20_000_000)] = None
    psi: Annotated[float | None, between(0.0, 1e6), BRANCHES] = None
    grid: str | None = None
    polarities: Annotated[int | None, between(1, 2)] = None
    channels: Annotated[int | None, between(1, MAX_CHANNELS)] = None
    layout: str | None = None
    columns: Annotated[int | None, between(1, MAX_CHANNELS)] = None
    merge_polarities: bool | None = None
    only_taxels: str | None = None
    only_polarity: Annotated[int | None, between(0, 1)] = None
    merge_channels: Annotated[int | None, between(1, MAX_CHANNELS)] = None
    axes: str | None = None
    align_events: Annotated[int | None, between(1, 20_000), SPIKING] = None
    split: Annotated[float | None, between(0.001, 0.9)] = None
    fold: Annotated[int | None, between(1, 1_000)] = None
    classes: str | None = None
    start_at: float | str | None = None
    time_unit: Annotated[str | None, tuple(TIME_UNITS)] = None
    max_steps: Annotated[int | None, between(1, MOST_STEPS)] = None
    theta: Annotated[float, between(1e-6, 1e6), SRM] = 10.0
    tau_sr: Annotated[float, between(1e-3, 1e5), SRM] = 10.0
    tau_ref: Annotated[float, between(1e-3, 1e5), SRM] = 1.0
    scale_ref: Annotated[float, between(0.0, 1e6), SRM] = 2.0
    tau_rho: Annotated[float, between(1e-6, 1e6), SRM] = 1.0
    scale_rho: Annotated[float, between(1e-6, 1e6), SRM] = 1.0
    decay: Annotated[float, SHARE, LIF] = 0.2
    threshold: Annotated[float, between(1e-6, 1e6), LIF] = 0.5
    window: Annotated[float, between(1e-6, 1e6), LEAKY] = 0.5
    dash_syn: Annotated[str, OF_XYLO] = "2"
    dash_mem: Annotated[str, OF_XYLO] = "4"
    location_theta: Annotated[float | None, between(1e-6, 1e6), LOCATION, SRM] = None
    location_tau_sr: Annotated[float | None, between(1e-3, 1e5), LOCATION, SRM] = None
    location_tau_ref: Annotated[float | None, between(1e-3, 1e5), LOCATION, SRM] = None
    location_decay: Annotated[float | None, SHARE, LOCATION, LIF] = None
    location_threshold: Annotated[float | None, between(1e-6, 1e6), LOCATION, LIF] = None
    graph: Annotated[str, GRAPHS, GRAPH] = "manual"
    neighbours: Annotated[int, between(1, 38), GRAPH] = 3
    nearer_mm: Annotated[float, between(0.0, 100.0), GRAPH] = 3.0
    hops: Annotated[int, between(1, 16), GRAPH] = 3
    features: Annotated[int, between(1, 1024), GRAPH] = 64
    step_features: Annotated[int, between(1, 1024), GRAPH] = 8
    window_steps: Annotated[int, between(1, 20_000), WINDOWS] = 6
    window_stride: Annotated[int, between(1, 20_000), WINDOWS] = 3
    window_levels: Annotated[str, WINDOWS] = "1 2"
    target: str = "float"
    strategy: Annotated[str, TRAINABLE, CHIP, SRM] = "dendrite"
    weight_bits: Annotated[int, WEIGHT_BITS, CHIP] = 8
    weight_room: Annotated[float, between(1e-3, 1e3), CHIP] = 1.25
    refractory: Annotated[int, between(1, 65_535), CHIP, RESETS] = 1
    pruned: Annotated[float, between(0.0, 0.999)] = 0.0
    spike_cost: Annotated[float, between(0.0, 1e3)] = 0.0
    tie: str | None = None

    called = "training option"

    @property
    def recorded(self) -> SensorLayout | None:
        """The sensor of the recordings that the options describe; None for NeuTouch."""
        polarities = self.polarities
        # Whoever merges or picks a polarity has a sensor with two.
        has_both = self.merge_polarities or self.only_polarity is not None
        if polarities is None and has_both and self._describes_sensor:
            polarities = POLARITIES
        return asked_layout(self.grid, polarities, self.channels, self.layout, self.columns)

    @property
    def sensor(self) -> SensorLayout | None:
        """The channels of that sensor that the network gets, as a sensor of their own; None for NeuTouch."""
        recorded = self.recorded
        return None if recorded is None else selected_layout(recorded, asked_selection(self))

    @property
    def _describes_sensor(self) -> bool:
        """Whether options describe the sensor."""
        descriptions = (self.grid, self.channels, self.layout)
        return any(description is not None for description in descriptions)


def check_used(given: Mapping[str, str], *configs: TrainingConfig) -> None:
    """Raise ``InputError`` for an option that has no effect in any of the configurations.

    ``given``: the names of the options that were given -> how messages show them.
    """
    for option, shown in given.items():
        for need in said_of(TrainingConfig)[option]:
            if not isinstance(need, Need):
                continue  # a range or choices
            has_effect = any(need.counts(c, ARCHITECTURES[c.model]) for c in configs)
            if not has_effect:
                raise InputError(shown, f"it would change nothing: {need.why}", fix=need.fix)


def config_from_mapping(
    values: Mapping[str, Any], where: str = "training options"
) -> TrainingConfig:
    """Return the configuration with these ``values``, and the network's defaults for all other options.

    Raises ``InputError`` for an unknown key or an invalid value.
    """
    if "model" not in values and is_xylo(str(values.get("target"))):
        values = {**values, "model": XYLO_MODEL}
    usual = USUAL.get(str(values.get("model")), {})
    return RecordReader(where).record(TrainingConfig, {**usual, **values})


def is_xylo(target: str) -> bool:
    """Return whether a target is a Xylo: by its name, or by what its chip file says."""
    return family_of(target) is XYLOS


def check_network_of_target(config: TrainingConfig) -> None:
    """Raise ``InputError`` if the target is a Xylo and the network is not for one, or the other way round."""
    is_for_xylo = is_xylo(config.target)
    if is_for_xylo and config.model != XYLO_MODEL:
        what = f"{config.target} has no neurons like those of {config.model!r}"
        raise InputError("training option 'model'", what, fix=f"Give {XYLO_MODEL}.")
    if config.model == XYLO_MODEL and not is_for_xylo:
        what = f"{XYLO_MODEL!r} exists in the integers of a Xylo only"
        measured = f"got {config.target}"
        fix = "Give xylo-audio2, xylo-audio3 or xylo-imu."
        raise InputError("training option 'target'", what, measured=measured, fix=fix)


def read_config(path: Path | str) -> dict[str, Any]:
    """Return the mapping in a YAML file, with its keys checked; options given elsewhere may override it.

    Raises ``InputError`` for a missing file, for one without a mapping, and for invalid keys or values.
    """
    where = f"config {Path(path).name!r}"
    values = read_mapping(Path(path), where, "Give the YAML file of a training run.")
    config_from_mapping(values, where)
    return values
