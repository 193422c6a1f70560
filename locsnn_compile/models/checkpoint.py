"""The trained checkpoint of this project: ``locsnn-checkpoint``, a plain dict in torch's own file format.

    {"format", "version", "name", "architecture", "neuron": {...}, "input": {...}, "hidden", "classes",
     "location_order": None or {"name", "taxels"}, "weights": {population: float32 tensor [out, in]},
     "recordings": None or {"spikes": uint8 (samples, steps, channels), "labels": int64 (samples,) or None},
     "training": {plain numbers and strings}}

That is version 1, a network of spike response neurons. One trained on a chip's arithmetic is version 2: its weights are
int16 mantissas, and

    "chip": {"target", "strategy", "registers": {width: bits},
             "populations": {population: {"threshold", "decay", "refractory_decay", "refractory",
                                          "own": [[mantissa, exponent, delay], ...],
                                          "exponent", "weight_bits", "scale", "unit"}}}

holds the other integers that the chip is loaded with; ``own`` are synapses of a neuron to itself. One of the
neurons of a Xylo is version 3 with int16 mantissas, ``time_recurrent`` among its weights, and

    "chip": {"target", "hidden_threshold", "output_threshold", "populations": {weights: {"shift", "unit"}}}

Any other network is version 3: its ``neuron`` holds the constants of integrate-and-fire neurons, or of windows, or
nothing, its weights may have any number of axes, there is a ``chip`` where windows were trained on a chip's arithmetic,
and

    "graph": None or {"name", "taxel_edges": [[a, b], ...], "hops", "features", "step_features"}

is its graph convolutions. Any version may hold ``"delays": [steps, ...]`` of the synapses from the recording onto
``time_hidden``, whose weights for each delay then lie side by side, ``"location_delays": [locations, ...]`` of those
onto ``location_hidden``, ``"location_neuron": {...}``, where the location branch has other constants than ``neuron``,
``"window": {"steps", "stride", "levels"}`` of a branch that counts in windows next to others, ``"align_events"`` of the
step at which recordings start, and ``"class_names": [names]``. In ``input`` there may be the ``event_threshold`` that
bins of single events had to exceed, and there is, where it is not NeuTouch, the ``sensor`` in place of its sizes: see
:class:`locsnn_compile.data.sensor.SensorLayout`. Several in one
file are ``locsnn-committee``:

    {"format", "version", "members": {"1": {"sha256", "weight", "checkpoint": as in a file of its own}, "2": ...}}

Only the first member that carries recordings keeps them. Written here, read by
:mod:`locsnn_compile.models.checkpoint_reader`, which never runs code of the file.
"""

import math
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hw_model.io.files import replace_file
from hw_model.mapping.recorded import RecordedChannels
from hw_model.values import AnyArray, Float32Array, Shown
from locsnn_compile.data.event_stream import FIRST, TIME_UNITS
from locsnn_compile.data.recordings import EventTimes, Recordings
from locsnn_compile.data.selection import recorded_in
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.torch_file import torch_bytes
from locsnn_compile.errors import InputError
from locsnn_compile.models.chip_entry import ChipNumbers, ChipPopulation, chip_entry
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.xylo_entry import XyloNumbers, XyloSynapses, xylo_entry

FORMAT = "locsnn-checkpoint"
VERSION = 3
"""The newest version."""
CHIP_VERSION = 2
"""That of spike response neurons on a chip's arithmetic."""
OPTIONAL = ("delays", "location_delays", "location_neuron", "class_names", "align_events", "window")
"""What of a description a file has only where it is not as usual, in this order."""
USUAL = {its.name: its.default for its in fields(NetworkDescription)}

#: What a training entry may be.
Plain = str | int | float | bool | None


class Checkpoint(Shown):
    """A trained network as read from a file.

    ``weights``: name -> float32 as in ``weight_shapes``, or int64 mantissas where there is a ``chip``; read-only, in
    evaluation order; ``recordings``: the ones the checkpoint carries for checks, or None; ``training``: how it came
    about, plain values; ``sha256`` of the file; ``chip``: the integers of a network trained on a chip's arithmetic,
    ``xylo``: of one trained on a Xylo's.
    """

    description: NetworkDescription
    weights: dict[str, AnyArray]
    recordings: Recordings | None = None
    training: dict[str, Plain] = field(default_factory=dict)
    sha256: str = ""
    chip: ChipNumbers | None = None
    xylo: XyloNumbers | None = None

    def save(self, path: Path | str) -> None:
        """Write it to a file, whole or not at all; equal ones give equal bytes under one version of torch.

        Raises ``InputError`` for weights that do not fit the description, are not finite or not on the grid, and where
        the folder cannot be written.
        """
        where = f"checkpoint {Path(path).name!r}"
        replace_file(Path(path), torch_bytes(checkpoint_values(self), where), where)

    @property
    def tie_class(self) -> int | None:
        """The class that is predicted where all scores tie; None: it names none, as those of earlier versions."""
        number = self.training.get("tie")
        if not isinstance(number, int) or isinstance(number, bool):
            return None
        return number if 0 <= number < self.description.classes else None

    @property
    def event_times(self) -> EventTimes | None:
        """How the events that it was trained on were timed; None if the training did not say it."""
        start = self.training.get("start_at")
        unit = self.training.get("time_unit")
        is_time = isinstance(start, int | float) and math.isfinite(start)
        known_start = start if is_time or start == FIRST else None
        known_unit = str(unit) if unit in TIME_UNITS else None
        if known_start is None and known_unit is None:
            return None
        return EventTimes(known_start, known_unit)

    @property
    def recorded(self) -> RecordedChannels | None:
        """The sensor of the recordings that it was trained on, where it got some of its channels, or merged ones."""
        return recorded_in(self.training, self.description.input.channels)

    @property
    def float_weights(self) -> dict[str, Float32Array]:
        """Weights [out, in] in the float network's units."""
        numbers = self.numbers
        if numbers is None:
            return self.weights
        return {
            name: weights.astype(np.float32)
            for name, weights in numbers.floats(self.weights).items()
        }

    @property
    def numbers(self) -> ChipNumbers | XyloNumbers | None:
        """The integers of a network that was trained on any chip's arithmetic."""
        return self.xylo if self.chip is None else self.chip


def checkpoint_values(checkpoint: Checkpoint) -> dict[str, Any]:
    """Return what a file holds, weights as arrays; see :meth:`Checkpoint.save`."""
    description, weights = checkpoint.description, checkpoint.weights
    chip, recordings = checkpoint.numbers, checkpoint.recordings
    arrays = {}
    for name in description.weight_shapes:
        description.check_shape(name, weights, "Save the weights of a network of this description.")
        check_weights(
            f"population {name!r}", weights[name], None if chip is None else chip.populations[name]
        )
        arrays[name] = np.array(
            weights[name], dtype=np.float32 if chip is None else np.int16, order="C"
        )
    srm, order = description.structure.neurons == "srm", description.location_taxels
    plain = asdict(description)
    if description.structure.neurons == "windows":
        plain |= {"neuron": plain["window"], "window": None}  # where there are no others
    values = {
        "format": FORMAT,
        "version": VERSION if not srm else CHIP_VERSION if chip is not None else 1,
        "name": description.name,
        "architecture": description.architecture,
        "neuron": plain["neuron"] or {},
        "input": _input_entry(description.input),
        "location_order": None
        if order is None
        else {"name": description.location_order, "taxels": list(order)},
        "hidden": description.hidden,
        "classes": description.classes,
        "weights": arrays,
        "recordings": None
        if recordings is None
        else {"spikes": recordings.spikes, "labels": recordings.labels},
        "training": dict(checkpoint.training),
    }
    if chip is not None:
        values["chip"] = xylo_entry(chip) if isinstance(chip, XyloNumbers) else chip_entry(chip)
    for name in OPTIONAL:
        if plain[name] != USUAL[name]:
            values[name] = list(plain[name]) if isinstance(plain[name], tuple) else plain[name]
    if not srm:
        graph = plain["graph"]
        values["graph"] = graph and graph | {
            "taxel_edges": [list(edge) for edge in graph["taxel_edges"]]
        }
    return values


class Pack(Shown):
    """Checkpoints whose class scores are added, each by its weight; ``sha256`` of the file."""

    members: tuple[Checkpoint, ...]
    weights: tuple[float, ...]
    sha256: str = ""

    FORMAT: ClassVar[str] = "locsnn-committee"
    VERSION: ClassVar[int] = 1

    def save(self, path: Path | str) -> None:
        """Write it to a file, whole or not at all."""
        carrying = next((member for member in self.members if member.recordings is not None), None)
        members = {}
        for number, (member, weight) in enumerate(
            zip(self.members, self.weights, strict=True), start=1
        ):
            values = checkpoint_values(
                member if member is carrying else replace(member, recordings=None)
            )
            members[str(number)] = {
                "sha256": member.sha256,
                "weight": float(weight),
                "checkpoint": values,
            }
        where = f"committee {Path(path).name!r}"
        content = torch_bytes(
            {"format": self.FORMAT, "version": self.VERSION, "members": members}, where
        )
        replace_file(Path(path), content, where)


def check_weights(
    where: str, weights: AnyArray, numbers: ChipPopulation | XyloSynapses | None
) -> None:
    """Raise ``InputError`` naming the first weight that is not finite, or the first mantissa that is not on the grid.

    Weights are mantissas where there are ``numbers``, on the grid of their weight format.
    """
    if numbers is None:
        kind, fault, bad = "weight", "finite", ~np.isfinite(weights)
    else:
        kind, fault = "mantissa", f"on the grid of {numbers.weight_bits} bits"
        bad = numbers.off_grid(weights)
    places = np.argwhere(bad)
    if len(places):
        measured = f"got {weights[tuple(places[0])]}, {len(places)} such {kind}s"
        fix = "Train the network again."
        raise InputError(
            where, f"{kind} {places[0].tolist()} is not {fault}", measured=measured, fix=fix
        )


def _input_entry(layout: InputLayout) -> dict[str, Any]:
    """Return the entry; of NeuTouch, and without a threshold, it is as it was before there were others."""
    sensor = layout.sensor
    entry: dict[str, Any] = {"steps": layout.steps, "step_seconds": layout.step_seconds}
    if sensor == neutouch(sensor.surfaces):
        entry = (
            {"fingertips": sensor.surfaces}
            | entry
            | {"taxels": sensor.taxels, "polarities": sensor.polarities}
        )
    else:
        entry["sensor"] = sensor.document()
    return (
        entry
        if layout.event_threshold is None
        else entry | {"event_threshold": layout.event_threshold}
    )
