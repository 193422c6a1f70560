"""Read a ``locsnn-checkpoint``: every entry is checked, and nothing in the file is ever run.

A pickle that would call code is refused. Sizes are checked before they are used. Every fault is one ``InputError`` that
names the entry.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.io.records import RecordReader, check_value, field_kinds
from hw_model.values import AnyArray, sealed
from locsnn_compile.data.recordings import Origin, Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS, SensorLayout, neutouch, parse_layout
from locsnn_compile.data.tensors import Tensor
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.models import checkpoint
from locsnn_compile.models.checkpoint import CHIP_VERSION, VERSION, Checkpoint, Pack, Plain
from locsnn_compile.models.chip_entry import WRITE_AGAIN, ChipNumbers, file_fault, parse_chip_entry
from locsnn_compile.models.description import (
    InputLayout,
    LifParameters,
    NetworkDescription,
    Neuron,
    NeuronParameters,
    XyloParameters,
)
from locsnn_compile.models.graph_and_windows import WindowParameters
from locsnn_compile.models.xylo_entry import XyloNumbers, parse_xylo_entry

_KEYS: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("format", "name", "architecture"), (str,)),
    **dict.fromkeys(("version", "hidden", "classes"), (int,)),
    **dict.fromkeys(("neuron", "input", "weights", "training"), (dict,)),
    **dict.fromkeys(("location_order", "recordings"), (dict, type(None))),
}
_LATER = (object, bool)
"""The type of an entry that is checked when it is read."""
_MEMBER: dict[str, tuple[type, ...]] = {"sha256": (str,), "weight": (float,), "checkpoint": (dict,)}


def read_checkpoint(path: Path | str) -> Checkpoint:
    """Return the checkpoint at ``path``; ``InputError`` for other files."""
    values, where, sha256 = read_plain(Path(path), WRITE_AGAIN)
    return parse_checkpoint(values, where, Path(path).name, sha256)


def read_models(path: Path | str, *, state_dict: str = WRITE_AGAIN) -> Checkpoint | Pack:
    """Return the checkpoint at ``path``, or the pack of several; ``InputError`` for anything else.

    ``state_dict`` is the way out for a bare state dict.
    """
    values, where, sha256 = read_plain(Path(path), state_dict)
    if not isinstance(values, dict) or values.get("format") != Pack.FORMAT:
        return parse_checkpoint(values, where, Path(path).name, sha256)
    check_same(
        values.get("version"), Pack.VERSION, where, "its version does not exist", fix=WRITE_AGAIN
    )
    check_keys(where, "", values, {"format": (str,), "version": (int,), "members": (dict,)})
    check_keys(where, "members", values["members"], dict.fromkeys(values["members"], (dict,)))
    members, weights = [], []
    for number, entry in values["members"].items():
        place = f"{where}, member {str(number)[:20]!r}"
        check_keys(place, "", entry, _MEMBER)
        if not re.fullmatch("[0-9a-f]{64}|", entry["sha256"]):
            raise file_fault(place, "its sha256 is not one")
        members.append(
            parse_checkpoint(entry["checkpoint"], place, Path(path).name, entry["sha256"])
        )
        weights.append(entry["weight"])
    if not members:
        raise file_fault(where, "it has no members")
    return Pack(tuple(members), tuple(weights), sha256)


def read_plain(path: Path, state_dict: str) -> tuple[object, str, str]:
    """Return what a file holds, how messages name it, and its sha256."""
    where = f"checkpoint {path.name!r}"
    data = read_bytes(path, where)
    values = load_plain(data, where, fix=WRITE_AGAIN)
    if _is_state_dict(values):
        raise InputError(
            where, "it contains tensors, but does not name their network", fix=state_dict
        )
    return values, where, hashlib.sha256(data).hexdigest()


def _is_state_dict(values: object) -> bool:
    """Tell whether a value is a dict of tensors, or a dict that holds one, without a format."""
    if not isinstance(values, dict) or "format" in values:
        return False
    return any(
        isinstance(v, Tensor) or (isinstance(v, dict) and _is_state_dict(v))
        for v in values.values()
    )


def parse_checkpoint(values: object, where: str, source: str, sha256: str) -> Checkpoint:
    """Return the checkpoint that the plain dict ``values`` describes, every entry checked."""
    if isinstance(values, dict) and values.get("format") == Pack.FORMAT:
        raise InputError(
            where,
            "it is a committee, not a single network",
            fix="Give the networks that it was made of.",
        )
    if not isinstance(values, dict) or values.get("format") != checkpoint.FORMAT:
        raise file_fault(where, "it is not a checkpoint of this project", _seen(values))
    version = _checked_version(values, where)
    description = _description(values, where, version)
    chip, of_xylo = _integers(values, where, description)
    weights = _weights(where, values["weights"], description, chip or of_xylo)
    training = _training(where, values["training"])
    recordings = _recordings(where, values["recordings"], description, source, _origin(training))
    return Checkpoint(description, weights, recordings, training, sha256, chip, of_xylo)


def _checked_version(values: dict[Any, Any], where: str) -> int:
    """Return the version of a checkpoint whose entries are those of its version; refuse newer and unknown ones."""
    version: Any = values.get("version")
    against = f"version {version} against {VERSION}"
    is_whole = type(version) is int
    if is_whole and version > VERSION:
        raise InputError(
            where,
            "it was written by a newer version",
            measured=against,
            fix="Update locsnn-compile.",
        )
    later_keys: dict[object, tuple[str, ...]] = {CHIP_VERSION: ("chip",), VERSION: ("graph",)}
    if "chip" in values:
        later_keys[VERSION] = ("graph", "chip")
    expected = list(later_keys.get(version, ())) if is_whole else []
    expected += [name for name in checkpoint.OPTIONAL if name in values]
    check_keys(where, "", values, _KEYS | dict.fromkeys(expected, _LATER))
    if version not in (1, *later_keys):
        raise file_fault(where, "its version does not exist", against)
    assert isinstance(version, int)
    return version


def _description(values: dict[Any, Any], where: str, version: int) -> NetworkDescription:
    """Return what a checkpoint says of its network; versions before the last one have spike response neurons alone."""
    has_srm = version != VERSION
    order = values["location_order"]
    if order is not None:
        check_keys(where, "location_order", order, {"name": (str,), "taxels": (list, tuple)})
    fields = {name: values.get(name, usual) for name, usual in checkpoint.USUAL.items()}
    fields |= {
        "location_order": order and order["name"],
        "location_taxels": order and order["taxels"],
    }
    try:
        parts: dict[str, Any] = {"input": _input(where, fields.pop("input"))}
        for name in ("neuron", "location_neuron"):
            parameters = fields.pop(name)
            parts[name] = _neuron(where, parameters, srm=has_srm) if name in values else None
        if isinstance(parts["neuron"], WindowParameters):
            # A network of windows alone has them in place of a neuron.
            if "window" not in values:
                del fields["window"]
            parts |= {"neuron": None, "window": parts["neuron"]}
        reader = RecordReader(where, WRITE_AGAIN, lacks=False)
        description = reader.record(NetworkDescription, fields, **parts)
    except InputError as error:
        place = error.where if error.where.startswith(where) else f"{where}, {error.where}"
        raise InputError(place, error.what, measured=error.measured, fix=error.fix) from None
    if (description.structure.neurons == "srm") != has_srm:
        raise file_fault(where, f"version {version} does not hold such networks")
    return description


def _integers(
    values: dict[Any, Any], where: str, description: NetworkDescription
) -> tuple[ChipNumbers | None, XyloNumbers | None]:
    """Return the integers of a network that was trained on them: those of a chip of cores, or of a Xylo."""
    if "chip" in values and not description.structure.learns_integers:
        raise file_fault(where, f"no {description.architecture!r} is trained on a chip's integers")
    if description.structure.neurons == "xylo":
        if "chip" not in values:
            raise file_fault(where, "a network of a Xylo's neurons has no float weights")
        return None, parse_xylo_entry(where, values["chip"], description.weight_shapes)
    if "chip" not in values:
        return None, None
    windows = description.window_names if description.structure.window_branch else ()
    return parse_chip_entry(where, values["chip"], description.weight_shapes, windows), None


def _seen(values: object) -> str:
    if not isinstance(values, dict):
        return f"a {type(values).__name__}"
    return f"format {values['format']!r}"[:80] if "format" in values else "a dict without a format"


def check_keys(where: str, key: str, values: Any, known: Mapping[str, tuple[type, ...]]) -> None:
    """Refuse entries that are unknown, missing, or of another kind."""
    reader = RecordReader(where, WRITE_AGAIN)
    for name, value in reader.entries(values, key, dict.fromkeys(known, True)).items():
        check_value(
            reader.place(f"{key}.{name}" if key else name), value, known[name], fix=WRITE_AGAIN
        )


def _input(where: str, entry: Mapping[str, Any]) -> InputLayout:
    """Return the input layout; files have sizes for NeuTouch, and the layout of any other sensor."""
    sizes = ("taxels", "polarities", "fingertips")
    of_sensor: dict[str, tuple[type, ...]] = dict.fromkeys(sizes, (int,))
    if "sensor" in entry:
        of_sensor = {"sensor": (dict,)}
    lacks = {"event_threshold", "sensor"} - set(entry)
    kinds = {name: kind for name, kind in field_kinds(InputLayout).items() if name not in lacks}
    check_keys(where, "input", entry, kinds | of_sensor)
    if "sensor" in entry:
        sensor = parse_layout(entry["sensor"], "input 'sensor'")
    else:
        sensor = SensorLayout("channels", *(entry[name] for name in sizes))
        if (sensor.taxels, sensor.polarities) == (TAXELS, POLARITIES):
            sensor = neutouch(sensor.surfaces)
    others = {name: value for name, value in entry.items() if name not in of_sensor}
    return InputLayout(sensor, **others)


def _neuron(where: str, entry: object, *, srm: bool) -> Neuron | WindowParameters | None:
    """Return the constants of neurons of any kind, or of windows; None if there are none."""
    if entry == {} and not srm:
        return None
    windows = isinstance(entry, dict) and "levels" in entry and not srm
    kind: type[Neuron | WindowParameters] = NeuronParameters if srm else LifParameters
    if windows:
        kind = WindowParameters
    elif isinstance(entry, dict) and "dash_mem" in entry:
        kind = XyloParameters
    return RecordReader(where, WRITE_AGAIN, lacks=False).record(kind, entry, "neuron")


def _weights(
    where: str,
    entry: dict[Any, Any],
    description: NetworkDescription,
    chip: ChipNumbers | XyloNumbers | None,
) -> dict[str, AnyArray]:
    """Return float32 weights, or int64 mantissas on the grid of ``chip``."""
    shapes = description.weight_shapes
    kind = "float32" if chip is None else "int16"
    check_keys(where, "weights", entry, dict.fromkeys(shapes, (Tensor,)))
    weights: dict[str, AnyArray] = {}
    for name, shape in shapes.items():
        place, tensor = f"{where}, population {name!r}", entry[name]
        check_same(
            tensor.shape, shape, place, "its weights have another shape (out, in)", fix=WRITE_AGAIN
        )
        if tensor.dtype != f"torch.{kind}" or not tensor.dense:
            stored = f"{tensor.layout.removeprefix('torch.')} on {tensor.device}"
            raise file_fault(
                place, f"its weights are not dense {kind}", f"got {tensor.dtype}, {stored}"
            )
        array = np.array(tensor.array(), dtype=np.float32 if chip is None else np.int64, order="C")
        checkpoint.check_weights(place, array, None if chip is None else chip.populations[name])
        weights[name] = sealed(array)
    return weights


def _recordings(
    where: str,
    entry: dict[Any, Any] | None,
    description: NetworkDescription,
    source: str,
    origin: Origin,
) -> Recordings | None:
    if entry is None:
        return None
    check_keys(where, "recordings", entry, {"spikes": (Tensor,), "labels": (Tensor, type(None))})
    spikes, labels, layout = entry["spikes"], entry["labels"], description.input
    place, kinds = f"{where}, recordings", (spikes.dtype, None if labels is None else labels.dtype)
    what, wanted = (
        "their steps and channels are not those of the input",
        (layout.steps, layout.channels),
    )
    check_same(spikes.shape[1:], wanted, place, what, fix=WRITE_AGAIN)
    dense = spikes.dense and (labels is None or labels.dense)
    if not dense or kinds not in (("torch.uint8", "torch.int64"), ("torch.uint8", None)):
        raise file_fault(
            place, "spikes must be dense uint8 and labels int64", f"got {kinds[0]} and {kinds[1]}"
        )
    try:
        vector = None if labels is None else labels.array()
        return Recordings(spikes.array(), vector, layout.step_seconds, source, origin)
    except InputError as error:
        raise InputError(place, error.what, measured=error.measured, fix=error.fix) from None


def _origin(training: Mapping[str, Plain]) -> Origin:
    """Return where the recordings in a checkpoint come from: without a test part, from the train part."""
    return (
        "trained on"
        if "test_recordings" in training and training["test_recordings"] is None
        else "carried"
    )


def _training(where: str, entry: dict[Any, Any]) -> dict[str, Plain]:
    for key, value in entry.items():
        if not isinstance(key, str) or not isinstance(value, str | int | float | bool | None):
            what = f"entry 'training.{str(key)[:60]}' is not a plain value"
            raise file_fault(where, what, f"got {type(value).__name__}")
    return dict(entry)
