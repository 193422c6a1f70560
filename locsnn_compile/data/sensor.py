"""Sensors: how many channels they have, and where these lie.

A tactile sensor has surfaces (such as fingertips) with taxels, which are single touch-sensitive points; an event camera
is one surface with a grid of pixels, which are called taxels here as well. NeuTouch, the sensor of the published
location networks, is built in; its tables are in ``neutouch.json``. Others are described by options (a grid, or a
number of channels) or by a YAML file. Sources of NeuTouch's tables: Kang et al. 2022 and its released configuration;
coordinates and edges from the TactileSGNet release (Gu et al. 2020).
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hw_model.io.records import RecordReader, between
from hw_model.io.yaml_text import read_mapping
from hw_model.values import FloatArray, Frozen, IntArray
from locsnn_compile.data.channels import Channels
from locsnn_compile.errors import InputError, check_same, counted

#: Largest number of channels of a sensor: an event camera of 128 x 128 pixels and two polarities.
MAX_CHANNELS = 32_768
#: Taxels of one NeuTouch fingertip, numbered from 1 in every file and order.
TAXELS = 39
#: Polarities of a taxel: 0 where pressure rises, 1 where it falls; channel = 2 * taxel + polarity, taxel from 0.
POLARITIES = 2

_FILE: dict[str, Any] = json.loads(Path(__file__).with_name("neutouch.json").read_text("utf-8"))
#: (x, y) of taxels 1..39 in millimetres, the centre of the fingertip at (0, 0).
TAXEL_COORDINATES_MM: tuple[tuple[float, float], ...] = tuple((x, y) for x, y in _FILE["positions"])
#: The published walks over one fingertip, 1-based taxel numbers.
LOCATION_ORDERS = {
    "loop": tuple(range(1, TAXELS + 1)),
    "arch": tuple(_FILE["arch"]),
    "whorl": tuple(_FILE["whorl"]),
}
#: Neighbours as the authors of TactileSGNet chose them by hand: pairs of taxel numbers, the lower first.
MANUAL_EDGES: tuple[tuple[int, int], ...] = tuple((a, b) for a, b in _FILE["edges"])
#: Taxel numbers by row (y from -8.9 to 8.9 mm) and column (x from -6 to 6 mm); 0 in empty cells. Every taxel has its
#: own cell, and the squared distances between taxels and the middles of their cells have the smallest possible sum.
FRAME_OF_TAXELS: tuple[tuple[int, ...], ...] = tuple(map(tuple, _FILE["frame"]))
_LEAST = 5
"""Fewest rows and columns of a frame: two convolutions by kernels of size 3, unpadded, leave one pixel of 5 x 5."""
_FIX = "Correct the layout of the sensor."


Coordinate = Annotated[float, between(-1e9, 1e9)]


class SensorLayout(Frozen):
    """The channels of a sensor, and where they lie.

    - ``surfaces``: number of equal parts, such as fingertips; ``taxels``: taxels of each surface; ``polarities``: of
      each taxel. channel = polarities * taxel + polarity, where taxels are counted from 0 through all surfaces.
    - ``columns``: width of the grid of a surface, whose taxels are numbered row by row; None if it is not a grid
    - ``positions``: the (x, y) of the taxels of one surface, in any unit, if known; a grid has its own
    - ``names``: names of the taxels of one surface, if they have names

    Raises ``InputError`` for layouts that contradict themselves.
    """

    name: str
    taxels: int
    polarities: int = 1
    surfaces: int = 1
    columns: int | None = None
    positions: tuple[tuple[Coordinate, Coordinate], ...] | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        limits = {"polarities": 2, "columns": self.taxels}
        for what in ("taxels", "polarities", "surfaces", "columns", "channels"):
            value = getattr(self, what)
            limit = limits.get(what, MAX_CHANNELS)
            if value is not None and not 1 <= value <= limit:
                raise self._refused(
                    f"its {what} are out of range", f"got {value} against 1..{limit}"
                )
        if self.taxels % (self.columns or 1):
            raise self._refused("its last row is not full", f"{self.taxels} taxels")
        if self.columns is not None and self.positions is not None:
            what = "its positions follow from its columns, but others were given"
            raise self._refused(what, counted(self.columns, "column"))
        for what, entries in (("positions", self.positions), ("names", self.names)):
            if entries is not None and not len(entries) == len(set(entries)) == self.taxels:
                counts = (
                    f"{len(set(entries))} different ones against {counted(self.taxels, 'taxel')}"
                )
                raise self._refused(f"its {what} do not fit its taxels", counts)

    def _refused(self, what: str, measured: str) -> InputError:
        return InputError(f"sensor {self.name!r}", what, measured=measured, fix=_FIX)

    @property
    def channels(self) -> int:
        """Number of channels on all surfaces."""
        return self.surfaces * self.taxels * self.polarities

    @property
    def laid_out(self) -> bool:
        """Whether anything but the number of channels is known."""
        return self.polarities == 2 or any(
            detail is not None for detail in (self.columns, self.positions, self.names)
        )

    @property
    def is_neutouch(self) -> bool:
        """Whether its surfaces are NeuTouch fingertips, for which there are published walks, graphs and frames."""
        return self.positions == TAXEL_COORDINATES_MM

    @property
    def places(self) -> FloatArray | None:
        """(x, y) of the taxels of one surface, (taxels, 2); None if their positions are not known."""
        if self.columns is not None:
            row, column = np.divmod(np.arange(self.taxels), self.columns)
            return np.stack([column, row], axis=1).astype(np.float64)
        return None if self.positions is None else np.array(self.positions, dtype=np.float64)

    @property
    def inputs(self) -> Channels | None:
        """Its channels as pixels; None for NeuTouch, whose files of events may count either taxels or channels."""
        if self.is_neutouch:
            return None
        places = self.surfaces * self.taxels
        if self.columns is None:
            return Channels(places, 1, self.polarities)
        return Channels(self.columns, places // self.columns, self.polarities)

    def needed_places(self, where: str) -> FloatArray:
        """Return :attr:`places`; ``InputError`` if they are unknown. ``where`` names what needs them."""
        if (places := self.places) is None:
            what = f"it needs to know where the taxels lie, and sensor {self.name!r} does not give their positions"
            raise InputError(where, what, fix="Give --grid WxH, or --layout FILE with positions.")
        return places

    def check_channels(self, found: int, where: str) -> None:
        """Refuse recordings whose channels are not those of the sensor."""
        what = f"their channels are not those of sensor {self.name!r}"
        fix = "Say which sensor it was: --grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE."
        check_same(found, self.channels, where, what, fix=fix)

    def document(self) -> dict[str, Any]:
        """Return the layout as plain values, without those that are None."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def neutouch(fingertips: int = 1) -> SensorLayout:
    """Return the layout of NeuTouch with this number of fingertips."""
    return SensorLayout("neutouch", TAXELS, POLARITIES, fingertips, positions=TAXEL_COORDINATES_MM)


def grid_layout(known: Channels | None) -> SensorLayout | None:
    """Return the layout of the grid that recordings state.

    None if they state none, if only their events show how large it is, and if it has more than two polarities.
    """
    if known is None or not known.is_grid or known.reached or known.polarities > POLARITIES:
        return None
    name = f"grid {known.columns}x{known.rows}"
    return SensorLayout(name, known.pixels, known.polarities, columns=known.columns)


def asked_layout(
    grid: str | None,
    polarities: int | None,
    channels: int | None,
    layout: str | None,
    columns: int | None = None,
) -> SensorLayout | None:
    """Return the layout that options ask for, or None if they ask for none; ``InputError`` if they ask for two.

    - ``grid``: a text, columns x rows such as ``34x34``, by default with two ``polarities``
    - ``channels``: a number of channels, by default with one polarity; without positions, or on a grid of ``columns``
    - ``layout``: the name of a file
    """
    if columns is not None and channels is None:
        what = "the grid or the layout has columns of its own"
        raise InputError("columns", what, measured=f"got {columns}", fix="Leave it out.")
    options = {"grid": grid, "channels": channels, "layout": layout}
    options_given = [name for name, value in options.items() if value is not None]
    if len(options_given) > 1 or (polarities is not None and not options_given):
        measured = " and ".join(options_given) or "polarities alone"
        fix = "Give one of --grid, --channels and --layout."
        raise InputError("sensor", "its layout is not clear", measured=measured, fix=fix)
    if grid is not None:
        match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d{0,3})", grid)
        if match is None:
            raise InputError(
                "grid", "it is not columns x rows", measured=f"got {grid[:40]!r}", fix="Give 16x16."
            )
        columns, rows = int(match[1]), int(match[2])
        return SensorLayout(f"grid {grid}", columns * rows, polarities or 2, columns=columns)
    if channels is not None:
        taxels, remainder = divmod(channels, polarities or 1)
        if remainder:
            raise InputError(
                "channels",
                "2 polarities need an even number",
                measured=f"{channels}",
                fix="Correct it.",
            )
        name = counted(channels, "channel")
        if columns is not None:
            name += f" in {counted(columns, 'column')}"
        return SensorLayout(name, taxels, polarities or 1, columns=columns)
    if layout is None:
        return None
    layout_of_file = read_layout(Path(layout))
    if polarities is None:
        return layout_of_file
    return replace(layout_of_file, polarities=polarities)


def read_layout(path: Path) -> SensorLayout:
    """Return the layout in a YAML file: see :func:`parse_layout`."""
    where = f"layout {path.name!r}"
    return parse_layout(
        {"name": path.stem} | read_mapping(path, where, "Give fewer taxels."), where
    )


def parse_layout(document: Mapping[Any, Any], where: str) -> SensorLayout:
    """Return the layout of a mapping with the fields of :class:`SensorLayout`.

    ``taxels`` may be missing if there are positions or names, whose number it then is. Raises ``InputError`` for
    anything else.
    """
    values = dict(document)
    per_taxel = values.get("positions", values.get("names"))
    if isinstance(per_taxel, list | tuple):
        values.setdefault("taxels", len(per_taxel))
    return RecordReader(where, _FIX).record(SensorLayout, values)


def frame_size(layout: SensorLayout) -> tuple[int, int]:
    """Return the rows and columns of the frame of a surface: those of a grid, or NeuTouch's 9 x 7.

    A frame is an image with a cell for every taxel, which the network ``cnn-3d`` convolves. Raises ``InputError`` for
    any other sensor, and for a grid that is too small for two convolutions.
    """
    if layout.is_neutouch:
        return len(FRAME_OF_TAXELS), len(FRAME_OF_TAXELS[0])
    rows = layout.taxels // (layout.columns or layout.taxels)
    if layout.columns is None or min(rows, layout.columns) < _LEAST:
        what = f"its frames need a grid of at least {_LEAST} x {_LEAST} taxels"
        fix = "Give --grid WxH of the sensor, or use another network."
        raise InputError("network 'cnn-3d'", what, measured=f"sensor {layout.name!r}", fix=fix)
    return rows, layout.columns


def frame_cells(layout: SensorLayout) -> IntArray:
    """Return the cell of every taxel in the frame of its surface, (taxels,), counted row by row from 0."""
    if layout.columns is not None:
        return np.arange(layout.taxels)
    flat = np.array(FRAME_OF_TAXELS).ravel()
    return np.array(
        [int(np.flatnonzero(flat == taxel)[0]) for taxel in range(1, layout.taxels + 1)]
    )
