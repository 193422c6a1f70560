"""The checkpoint of a trained network: the file format ``locsnn-checkpoint``, a plain dict in torch's own file format.

``locsnn train`` writes it, and the compiler reads it by :mod:`locsnn_compile.models.checkpoint_reader`, which never
runs code of the file. *Version 1* is a network of spike response neurons:

    {"format", "version", "name", "architecture", "neuron": {...}, "input": {...}, "hidden", "classes",
     "location_order": None or {"name", "taxels"}, "weights": {population: float32 tensor [out, in]},
     "recordings": None or {"spikes": uint8 (samples, steps, channels), "labels": int64 (samples,) or None},
     "training": {plain numbers and strings}}

*Version 2* is such a network trained on a chip's integer arithmetic: its weights are int16 mantissas, and

    "chip": {"target", "strategy", "registers": {width: bits},
             "populations": {population: {"threshold", "decay", "refractory_decay", "refractory",
                                          "own": [[mantissa, exponent, delay], ...],
                                          "exponent", "weight_bits", "scale", "unit"}}}

holds the other integers that the chip is loaded with (:mod:`.chip_entry`); ``own`` are synapses of a neuron to itself.

*Version 3* is any other network. Its ``neuron`` holds the constants of integrate-and-fire neurons, or of windows, or
nothing; its weights may have any number of axes; a network that counts in windows may have a ``chip`` as above; and

    "graph": None or {"name", "taxel_edges": [[a, b], ...], "hops", "features", "step_features"}

is its graph convolutions. A network of the neurons of a Xylo has int16 mantissas, ``time_recurrent`` among its weights,
and (:mod:`.xylo_entry`)

    "chip": {"target", "hidden_threshold", "output_threshold", "populations": {weights: {"shift", "unit"}}}

Any version may hold these entries, which are fields of :class:`~locsnn_compile.models.description.NetworkDescription`:

- ``"delays": [steps, ...]`` of the synapses from the recording onto ``time_hidden``; the weights for each delay then
  lie side by side
- ``"location_delays": [locations, ...]``, the same for ``location_hidden``
- ``"location_neuron": {...}``, if the location branch has other constants than ``neuron``
- ``"window": {"steps", "stride", "levels"}`` of a branch that counts in windows next to others
- ``"align_events"``, the number of events in one step at which a recording starts
- ``"class_names": [names]``
- in ``input``, the ``event_threshold`` that bins of single events had to exceed
- in ``input``, if the sensor is not NeuTouch, the ``sensor`` in place of its sizes: see
  :class:`locsnn_compile.data.sensor.SensorLayout`

Several networks whose class scores are added, a committee, are one file of the format ``locsnn-committee``:

    {"format", "version", "members": {"1": {"sha256", "weight", "checkpoint": as in a file of its own}, "2": ...}}

Only the first member that carries recordings keeps them.
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
SRM_VERSION = 1
"""The version of spike response neurons."""
CHIP_VERSION = 2
"""The version of spike response neurons on a chip's arithmetic."""
GENERAL_VERSION = 3
"""The version of any other network; it has an entry ``graph``."""
VERSION = GENERAL_VERSION
"""The newest version."""
OPTIONAL = ("delays", "location_delays", "location_neuron", "class_names", "align_events", "window")
"""The entries that a file has, in this order, only if they differ from the default of the description's field."""
USUAL = {
    description_field.name: description_field.default
    for description_field in fields(NetworkDescription)
}
"""The default of every field of a description, by name; ``dataclasses.MISSING`` for a field without a default."""

#: What a training entry may be.
Plain = str | int | float | bool | None


class Checkpoint(Shown):
    """A trained network as read from a file.

    - ``weights``: name -> float32 array of the shape in ``weight_shapes``, or int64 mantissas if there is a ``chip`` or
      ``xylo``; read-only, in evaluation order
    - ``recordings``: a few recordings that the checkpoint carries for checks of the compiled network, or None
    - ``training``: how it was trained, as plain values
    - ``sha256``: of the file
    - ``chip``: the integers of a network trained on the arithmetic of a chip with cores; ``xylo``: the same of a Xylo
    """

    description: NetworkDescription
    weights: dict[str, AnyArray]
    recordings: Recordings | None = None
    training: dict[str, Plain] = field(default_factory=dict)
    sha256: str = ""
    chip: ChipNumbers | None = None
    xylo: XyloNumbers | None = None

    def save(self, path: Path | str) -> None:
        """Write it to a file, whole or not at all; equal checkpoints give equal bytes under one version of torch.

        Raises ``InputError`` for weights that do not fit the description, are not finite, or are not on the grid of the
        chip's format, and if the folder cannot be written.
        """
        where = f"checkpoint {Path(path).name!r}"
        replace_file(Path(path), torch_bytes(checkpoint_values(self), where), where)

    @property
    def tie_class(self) -> int | None:
        """The class that is predicted if the scores of all classes are equal; None if the training does not name it."""
        number = self.training.get("tie")
        if not isinstance(number, int) or isinstance(number, bool):
            return None
        return number if 0 <= number < self.description.classes else None

    @property
    def event_times(self) -> EventTimes | None:
        """How the events that it was trained on were timed; None if the training does not say it."""
        start = self.training.get("start_at")
        unit = self.training.get("time_unit")
        is_time = isinstance(start, int | float) and math.isfinite(start)
        # The entries of a file from a stranger may be anything: other values count as not given.
        valid_start = start if is_time or start == FIRST else None
        valid_unit = str(unit) if unit in TIME_UNITS else None
        if valid_start is None and valid_unit is None:
            return None
        return EventTimes(valid_start, valid_unit)

    @property
    def recorded(self) -> RecordedChannels | None:
        """The sensor of the training recordings, if the network got only some of its channels, or merged ones."""
        return recorded_in(self.training, self.description.input.channels)

    @property
    def float_weights(self) -> dict[str, Float32Array]:
        """The weights [out, in] as float32, for any network."""
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
    """Return the dict that a file holds, with weights as arrays; for errors see :meth:`Checkpoint.save`.

    The order of entries is that of the file: equal checkpoints must give equal bytes.
    """
    description = checkpoint.description
    chip = checkpoint.numbers
    has_srm = description.structure.neurons == "srm"
    plain = asdict(description)
    if description.structure.neurons == "windows":
        # A network that only counts in windows stores these as its neuron.
        plain |= {"neuron": plain["window"], "window": None}
    version = GENERAL_VERSION
    if has_srm:
        version = SRM_VERSION if chip is None else CHIP_VERSION
    values = {
        "format": FORMAT,
        "version": version,
        "name": description.name,
        "architecture": description.architecture,
        "neuron": plain["neuron"] or {},
        "input": _input_entry(description.input),
        "location_order": _order_entry(description),
        "hidden": description.hidden,
        "classes": description.classes,
        "weights": _weight_arrays(checkpoint),
        "recordings": _recordings_entry(checkpoint.recordings),
        "training": dict(checkpoint.training),
    }
    if chip is not None:
        values["chip"] = xylo_entry(chip) if isinstance(chip, XyloNumbers) else chip_entry(chip)
    for name in OPTIONAL:
        if plain[name] != USUAL[name]:
            values[name] = list(plain[name]) if isinstance(plain[name], tuple) else plain[name]
    if not has_srm:
        graph = plain["graph"]
        if graph is not None:
            graph = graph | {"taxel_edges": [list(edge) for edge in graph["taxel_edges"]]}
        values["graph"] = graph
    return values


def _weight_arrays(checkpoint: Checkpoint) -> dict[str, AnyArray]:
    """Return the weights in the types of a file; ``InputError`` for weights that do not fit or are out of range."""
    description = checkpoint.description
    chip = checkpoint.numbers
    kind = np.float32 if chip is None else np.int16
    arrays = {}
    for name in description.weight_shapes:
        fix = "Save the weights of a network of this description."
        description.check_shape(name, checkpoint.weights, fix)
        weights = checkpoint.weights[name]
        numbers = None if chip is None else chip.populations[name]
        check_weights(f"population {name!r}", weights, numbers)
        arrays[name] = np.array(weights, dtype=kind, order="C")
    return arrays


def _order_entry(description: NetworkDescription) -> dict[str, Any] | None:
    """Return the entry of the location order; None for a network without a location branch."""
    if description.location_taxels is None:
        return None
    return {"name": description.location_order, "taxels": list(description.location_taxels)}


def _recordings_entry(recordings: Recordings | None) -> dict[str, Any] | None:
    """Return the entry of the recordings that a checkpoint carries."""
    if recordings is None:
        return None
    return {"spikes": recordings.spikes, "labels": recordings.labels}


class Pack(Shown):
    """The file of a committee: checkpoints whose class scores are added, each times its weight.

    ``sha256`` is that of the file.
    """

    members: tuple[Checkpoint, ...]
    weights: tuple[float, ...]
    sha256: str = ""

    FORMAT: ClassVar[str] = "locsnn-committee"
    VERSION: ClassVar[int] = 1

    def save(self, path: Path | str) -> None:
        """Write it to a file, whole or not at all."""
        # Members of one committee usually carry the same recordings: once is enough.
        carrying = next((member for member in self.members if member.recordings is not None), None)
        members = {}
        for number, (member, weight) in enumerate(
            zip(self.members, self.weights, strict=True), start=1
        ):
            if member is not carrying:
                stored_member = replace(member, recordings=None)
            else:
                stored_member = member
            members[str(number)] = {
                "sha256": member.sha256,
                "weight": float(weight),
                "checkpoint": checkpoint_values(stored_member),
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

    With ``numbers``, the integers of a chip, weights are mantissas, and the grid is that of their format.
    """
    if numbers is None:
        kind = "weight"
        fault = "finite"
        bad = ~np.isfinite(weights)
    else:
        kind = "mantissa"
        fault = f"on the grid of {numbers.weight_bits} bits"
        bad = numbers.off_grid(weights)
    places = np.argwhere(bad)
    if len(places):
        measured = f"got {weights[tuple(places[0])]}, {len(places)} such {kind}s"
        fix = "Train the network again."
        raise InputError(
            where, f"{kind} {places[0].tolist()} is not {fault}", measured=measured, fix=fix
        )


def _input_entry(layout: InputLayout) -> dict[str, Any]:
    """Return the entry ``input``. NeuTouch is stored by its sizes, and any other sensor as its layout."""
    sensor = layout.sensor
    entry: dict[str, Any] = {"steps": layout.steps, "step_seconds": layout.step_seconds}
    if sensor == neutouch(sensor.surfaces):
        sizes = {"taxels": sensor.taxels, "polarities": sensor.polarities}
        entry = {"fingertips": sensor.surfaces} | entry | sizes
    else:
        entry["sensor"] = sensor.document()
    if layout.event_threshold is not None:
        entry["event_threshold"] = layout.event_threshold
    return entry
