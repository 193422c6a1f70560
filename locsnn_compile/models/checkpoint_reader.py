"""Read a ``locsnn-checkpoint``: every entry is checked, and nothing in the file is ever run.

The format is described in :mod:`locsnn_compile.models.checkpoint`. A pickle that would call code is refused. Sizes are
checked before they are used. Every fault is one ``InputError`` that names the entry.
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
from locsnn_compile.models.checkpoint import (
    CHIP_VERSION,
    GENERAL_VERSION,
    SRM_VERSION,
    VERSION,
    Checkpoint,
    Pack,
    Plain,
)
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
"""The entries of every checkpoint -> their types."""
_LATER = (object, bool)
"""Any type, for entries that are checked when they are read. ``bool`` is named because the check takes a bool for
an int only if it is listed."""
_MEMBER: dict[str, tuple[type, ...]] = {"sha256": (str,), "weight": (float,), "checkpoint": (dict,)}
"""The entries of a member of a committee -> their types."""


def read_checkpoint(path: Path | str) -> Checkpoint:
    """Return the checkpoint at ``path``; ``InputError`` for other files."""
    values, where, sha256 = read_plain(Path(path), WRITE_AGAIN)
    return parse_checkpoint(values, where, Path(path).name, sha256)


def read_models(path: Path | str, *, state_dict: str = WRITE_AGAIN) -> Checkpoint | Pack:
    """Return the checkpoint at ``path``, or the committee of several; ``InputError`` for anything else.

    ``state_dict`` is the fix that the error suggests for a bare state dict of torch.
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
        # It may be empty, if the member never was a file of its own.
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
    """Return (what a file holds, its name in errors, its sha256); ``state_dict`` as in :func:`read_models`."""
    where = f"checkpoint {path.name!r}"
    data = read_bytes(path, where)
    values = load_plain(data, where, fix=WRITE_AGAIN)
    if _is_state_dict(values):
        raise InputError(
            where, "it contains tensors, but does not name their network", fix=state_dict
        )
    return values, where, hashlib.sha256(data).hexdigest()


def _is_state_dict(values: object) -> bool:
    """Return whether a value is a dict without a format that holds tensors, at any depth."""
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
    return Checkpoint(
        description=description,
        weights=weights,
        recordings=recordings,
        training=training,
        sha256=sha256,
        chip=chip,
        xylo=of_xylo,
    )


def _checked_version(values: dict[Any, Any], where: str) -> int:
    """Return the version of a checkpoint; refuse unknown ones, and entries that are not those of the version."""
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
    # The entries that a version must have in addition to those of version 1.
    later_keys: dict[object, tuple[str, ...]] = {
        CHIP_VERSION: ("chip",),
        GENERAL_VERSION: ("graph",),
    }
    if "chip" in values:
        later_keys[GENERAL_VERSION] = ("graph", "chip")
    expected = list(later_keys.get(version, ())) if is_whole else []
    expected += [name for name in checkpoint.OPTIONAL if name in values]
    # The entries are checked before an unknown version is refused: a version of another type is then a fault of
    # the entry "version", whose type is in _KEYS.
    check_keys(where, "", values, _KEYS | dict.fromkeys(expected, _LATER))
    if version not in (SRM_VERSION, *later_keys):
        raise file_fault(where, "its version does not exist", against)
    assert isinstance(version, int)
    return version


def _description(values: dict[Any, Any], where: str, version: int) -> NetworkDescription:
    """Return the description of the network; versions 1 and 2 have spike response neurons, and version 3 has others."""
    has_srm = version != GENERAL_VERSION
    order = values["location_order"]
    if order is not None:
        check_keys(where, "location_order", order, {"name": (str,), "taxels": (list, tuple)})
    # Fields without a default, such as `input`, are in the file: `_checked_version` has required their entries.
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
            # A network that only counts in windows has stored these as its neuron. If the file has an entry
            # `window` as well, that entry stays among the fields, and the record reader refuses it as unknown.
            if "window" not in values:
                del fields["window"]
            parts |= {"neuron": None, "window": parts["neuron"]}
        reader = RecordReader(where, WRITE_AGAIN, may_omit_defaults=False)
        description = reader.record(NetworkDescription, fields, **parts)
    except InputError as error:
        # Errors of the description's own checks do not know the file.
        place = error.where if error.where.startswith(where) else f"{where}, {error.where}"
        raise InputError(place, error.what, measured=error.measured, fix=error.fix) from None
    if (description.structure.neurons == "srm") != has_srm:
        raise file_fault(where, f"version {version} does not hold such networks")
    return description


def _integers(
    values: dict[Any, Any], where: str, description: NetworkDescription
) -> tuple[ChipNumbers | None, XyloNumbers | None]:
    """Return (integers of a chip with cores, integers of a Xylo), of which at most one is not None."""
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
    """Return what a file holds in place of a checkpoint, for the error."""
    if not isinstance(values, dict):
        return f"a {type(values).__name__}"
    return f"format {values['format']!r}"[:80] if "format" in values else "a dict without a format"


def check_keys(where: str, key: str, values: Any, known: Mapping[str, tuple[type, ...]]) -> None:
    """Refuse a dict ``values`` with entries that are unknown, missing, or of another type than ``known`` says.

    ``key`` is where the dict lies in the file, for errors; empty for the file itself.
    """
    reader = RecordReader(where, WRITE_AGAIN)
    is_required = dict.fromkeys(known, True)
    for name, value in reader.entries(values, key, is_required).items():
        place = reader.place(f"{key}.{name}" if key else name)
        check_value(place, value, known[name], fix=WRITE_AGAIN)


def _input(where: str, entry: Mapping[str, Any]) -> InputLayout:
    """Return the input layout. Files have the sizes of NeuTouch, or the layout of any other sensor."""
    sizes = ("taxels", "polarities", "fingertips")
    of_sensor: dict[str, tuple[type, ...]] = dict.fromkeys(sizes, (int,))
    if "sensor" in entry:
        of_sensor = {"sensor": (dict,)}
    # Two fields of InputLayout may be missing in a file. Without `sensor`, the sizes describe the sensor.
    missing = {"event_threshold", "sensor"} - set(entry)
    kinds = {name: kind for name, kind in field_kinds(InputLayout).items() if name not in missing}
    check_keys(where, "input", entry, kinds | of_sensor)
    if "sensor" in entry:
        sensor = parse_layout(entry["sensor"], "input 'sensor'")
    else:
        sensor = SensorLayout(
            "channels",
            taxels=entry["taxels"],
            polarities=entry["polarities"],
            surfaces=entry["fingertips"],
        )
        if (sensor.taxels, sensor.polarities) == (TAXELS, POLARITIES):
            sensor = neutouch(sensor.surfaces)
    other_fields = {name: value for name, value in entry.items() if name not in of_sensor}
    return InputLayout(sensor, **other_fields)


def _neuron(where: str, entry: object, *, srm: bool) -> Neuron | WindowParameters | None:
    """Return the constants of neurons of any kind, or of windows; None if there are none.

    ``srm``: whether the version of the file has spike response neurons. In other versions, the names of the constants
    show the kind.
    """
    if entry == {} and not srm:
        return None
    names = entry if isinstance(entry, dict) else {}
    kind: type[Neuron | WindowParameters] = NeuronParameters if srm else LifParameters
    if "levels" in names and not srm:
        kind = WindowParameters
    elif "dash_mem" in names:
        # In any version: where the version has spike response neurons, `_description` refuses the network.
        kind = XyloParameters
    reader = RecordReader(where, WRITE_AGAIN, may_omit_defaults=False)
    return reader.record(kind, entry, "neuron")


def _weights(
    where: str,
    entry: dict[Any, Any],
    description: NetworkDescription,
    chip: ChipNumbers | XyloNumbers | None,
) -> dict[str, AnyArray]:
    """Return the weights by name, read-only: float32, or with ``chip`` int64 mantissas on its grid.

    A file holds mantissas as int16, which has room for the mantissas of every chip; they are computed with as int64.

    Raises ``InputError`` for weights of other names, shapes or types, and for values out of range.
    """
    shapes = description.weight_shapes
    kind = "float32" if chip is None else "int16"
    check_keys(where, "weights", entry, dict.fromkeys(shapes, (Tensor,)))
    weights: dict[str, AnyArray] = {}
    for name, shape in shapes.items():
        place = f"{where}, population {name!r}"
        tensor = entry[name]
        # Before the array is made: a tensor may claim any shape, with few stored values.
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
    """Return the recordings that the checkpoint carries; None if there are none.

    ``source`` and ``origin`` are those of :class:`Recordings`. Raises ``InputError`` for recordings of another shape or
    type.
    """
    if entry is None:
        return None
    check_keys(where, "recordings", entry, {"spikes": (Tensor,), "labels": (Tensor, type(None))})
    spikes = entry["spikes"]
    labels = entry["labels"]
    layout = description.input
    place = f"{where}, recordings"
    kinds = (spikes.dtype, None if labels is None else labels.dtype)
    expected_shape = (layout.steps, layout.channels)
    what = "their steps and channels are not those of the input"
    check_same(spikes.shape[1:], expected_shape, place, what, fix=WRITE_AGAIN)
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
    """Return where the recordings in a checkpoint come from.

    A checkpoint carries recordings of the test part. If its training states that there was none (the entry is there,
    and is None), they are training recordings, and no accuracy may be claimed on them. Files without the entry, which
    ``locsnn train`` does not write, count as files with a test part.
    """
    has_no_test_part = "test_recordings" in training and training["test_recordings"] is None
    return "trained on" if has_no_test_part else "carried"


def _training(where: str, entry: dict[Any, Any]) -> dict[str, Plain]:
    """Return the entry ``training``; ``InputError`` unless its values are plain."""
    for key, value in entry.items():
        if not isinstance(key, str) or not isinstance(value, str | int | float | bool | None):
            what = f"entry 'training.{str(key)[:60]}' is not a plain value"
            raise file_fault(where, what, f"got {type(value).__name__}")
    return dict(entry)
