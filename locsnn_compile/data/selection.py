"""Some channels of a sensor, and one channel for several of them: of recordings, and of the sensor's layout.

Taxels are picked first, then a polarity, or both polarities become one; then neighbours, in the order of their
numbers, become one channel.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.mapping.recorded import ChannelSelection, RecordedChannels
from hw_model.values import FloatArray, Frozen, IntArray, picked
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError, check_most

MAX_NUMBER_LETTERS = 6
"""Of the number of a taxel."""
SELECTING = ("merge_polarities", "only_taxels", "only_polarity", "merge_channels")
"""The options that make a selection."""
_SIZES = ("columns", "rows", "polarities")


class _Places(Frozen, eq=False):
    """The taxels, from 0, that each place of a selection joins, and the polarities that it has of each."""

    taxels: tuple[IntArray, ...]
    polarities: tuple[int, ...]

    @property
    def joins(self) -> bool:
        """Whether a place is several taxels."""
        return any(len(members) > 1 for members in self.taxels)

    @property
    def in_order(self) -> IntArray:
        """The taxels that are read."""
        return np.concatenate(self.taxels)


def selected_layout(layout: SensorLayout, selection: ChannelSelection) -> SensorLayout:
    """Return a sensor of the channels that are read; ``InputError`` for a selection that it does not have."""
    if selection.merge_polarities:
        layout = replace(layout, polarities=1)
    if selection.merges_polarities_at_most:
        return layout
    taxels = layout.surfaces * layout.taxels
    places = _places(selection, taxels, layout.polarities)
    polarities = len(places.polarities)
    if len(places.in_order) == taxels and not places.joins:
        return replace(layout, polarities=polarities)
    count = len(places.taxels)
    return SensorLayout(
        name=layout.name,
        taxels=count,
        polarities=polarities,
        columns=count if layout.columns == taxels else None,
        positions=_positions(layout, places),
        names=_names(layout, places),
    )


def _positions(layout: SensorLayout, places: _Places) -> tuple[tuple[float, float], ...] | None:
    """Return where the places lie, each in the middle of its taxels; None where nobody knows, or two coincide.

    A row of a grid has the positions of its columns.
    """
    known = layout.places
    in_a_row = layout.columns == layout.taxels
    if known is None or layout.surfaces > 1 or in_a_row:
        return None
    middles = [_middle(known[members]) for members in places.taxels]
    return tuple(middles) if len(set(middles)) == len(middles) else None


def _middle(positions: FloatArray) -> tuple[float, float]:
    x, y = positions.mean(axis=0)
    return float(x), float(y)


def _names(layout: SensorLayout, places: _Places) -> tuple[str, ...] | None:
    if layout.names is None or layout.surfaces > 1 or places.joins:
        return None
    return tuple(layout.names[taxel] for taxel in places.in_order)


def selected(
    recordings: Recordings, selection: ChannelSelection, merged_polarities: int
) -> Recordings:
    """Return the channels that are read of recordings whose polarities are merged, if they are to be.

    ``merged_polarities``: how many the sensor has, where they have been merged. Raises ``InputError`` for
    recordings of unknown channels, and for a selection that they do not have.
    """
    if selection == ChannelSelection():
        return recordings
    own = recordings.channels
    if own is None:
        what = "it is not known which channels belong to a taxel, so none can be picked or merged"
        fix = "Give --grid WxH, --layout FILE, or --channels N, with --polarities."
        raise InputError(f"recordings {recordings.source!r}", what, fix=fix)
    polarities = merged_polarities if selection.merge_polarities else own.polarities
    recorded = RecordedChannels(own.columns, own.rows, polarities, selection)
    if selection.merges_polarities_at_most:
        # Where only events show how large the sensor is, another recording may show more of it.
        return recordings if own.reached else replace(recordings, recorded=recorded)
    places = _places(selection, own.pixels, own.polarities)
    cells = own.numbers().reshape(own.pixels, own.polarities)[:, places.polarities]
    channels = [
        recordings.spikes[:, :, cells[members, number]].max(axis=2)
        for members in places.taxels
        for number in range(len(places.polarities))
    ]
    return replace(
        recordings,
        spikes=np.stack(channels, axis=2),
        channels=_channels(own, places),
        recorded=recorded,
    )


def _channels(own: Channels, places: _Places) -> Channels:
    """Return the places as pixels: those of the grid where each of its taxels is one of them."""
    polarities = len(places.polarities)
    if len(places.taxels) == own.pixels:
        return Channels(own.columns, own.rows, polarities, reached=own.reached)
    return Channels(len(places.taxels), 1, polarities)


def selected_count(channels: int, polarities: int, selection: ChannelSelection) -> int:
    """Return how many of the channels of a sensor remain; ``InputError`` for a selection that it does not have."""
    places = _places(
        replace(selection, merge_polarities=False),
        channels // polarities,
        1 if selection.merge_polarities else polarities,
    )
    return len(places.taxels) * len(places.polarities)


def _places(selection: ChannelSelection, taxels: int, polarities: int) -> _Places:
    """Return the places of a selection from so many taxels of so many polarities."""
    numbers = np.arange(taxels)
    if selection.only_taxels is not None:
        numbers = taxel_numbers(selection.only_taxels, taxels)
    wanted: tuple[int, ...] = tuple(range(polarities))
    if selection.only_polarity is not None:
        if polarities == 1:
            what = "the sensor has one polarity, so none can be picked"
            fix = "Leave it out, or add --polarities 2."
            raise InputError("only_polarity", what, fix=fix)
        wanted = (selection.only_polarity,)
    if selection.merge_channels is None:
        return _Places(tuple(numbers[:, np.newaxis]), wanted)
    count = _merged_places(selection.merge_channels, len(numbers), len(wanted))
    return _Places(tuple(np.array_split(numbers, count)), wanted)


def _merged_places(channels: int, taxels: int, polarities: int) -> int:
    """Return how many places so many channels are."""
    most = taxels * polarities
    fix = "Give fewer, or leave it out."
    check_most(channels, most, "merge_channels", "there are fewer channels to merge", fix=fix)
    count, rest = divmod(channels, polarities)
    if rest:
        what = f"each place has {polarities} polarities, so channels are a multiple of that"
        fix = "Give another number, or add --merge-polarities."
        raise InputError("merge_channels", what, measured=f"got {channels}", fix=fix)
    return count


def taxel_numbers(text: str, taxels: int) -> IntArray:
    """Return the taxels, from 0, that a text such as ``13-24,30`` names from 1 on, in its order."""
    numbers: list[int] = []
    for part in text.replace(",", " ").split():
        first, dash, last = part.partition("-")
        ends = [first, last] if dash else [first]
        if not all(_is_number(end) for end in ends):
            raise _not_taxels(text, taxels)
        numbers += range(int(ends[0]), int(ends[-1]) + 1)
        if len(numbers) > taxels:
            break
    in_sensor = bool(numbers) and min(numbers) >= 1 and max(numbers) <= taxels
    if not in_sensor or len(set(numbers)) < len(numbers):
        raise _not_taxels(text, taxels)
    return np.array(numbers) - 1


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= MAX_NUMBER_LETTERS


def _not_taxels(text: str, taxels: int) -> InputError:
    what = "they are not different taxels of the sensor"
    fix = "Give, for example, 1-12 or 1,5,9."
    return InputError("only_taxels", what, measured=f"got {text[:40]!r} of 1..{taxels}", fix=fix)


def asked_selection(options: object) -> ChannelSelection:
    """Return the selection that the options :data:`SELECTING` ask for, which are attributes; None is not given."""
    values = picked(options, *SELECTING)
    return ChannelSelection(**values | {"merge_polarities": bool(values["merge_polarities"])})


def recorded_entries(recorded: RecordedChannels) -> dict[str, Any]:
    """Return a sensor and what is read of it as the entries of a checkpoint's training."""
    sizes = picked(recorded, *_SIZES)
    entries = {f"recorded_{name}": size for name, size in sizes.items()}
    return entries | picked(recorded.selection, *SELECTING)


def recorded_in(training: Mapping[str, Any], channels: int) -> RecordedChannels | None:
    """Return what the entries of a training say; None where they do not make so many channels."""
    sizes: dict[str, Any] = {name: training.get(f"recorded_{name}") for name in _SIZES}
    if None in sizes.values():
        return None
    values: dict[str, Any] = {name: training.get(name) for name in SELECTING}
    values["merge_polarities"] = values["merge_polarities"] is True
    # A checkpoint is a file of a stranger, and its training is only what it says of itself.
    try:
        recorded = RecordedChannels(**sizes, selection=ChannelSelection(**values))
        remain = selected_count(recorded.count, recorded.polarities, recorded.selection)
    except InputError:
        return None
    return recorded if remain == channels else None
