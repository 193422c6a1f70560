"""Pick some channels of a sensor and merge several into one, so that a small chip can take its recordings.

The options are those of :class:`hw_model.mapping.recorded.ChannelSelection`. They apply in this order: taxels are
picked; a polarity is picked, or both become one; then neighbours, in the order of their numbers, are merged into one
channel, which spikes if any of them does. What remains of a taxel, or of the taxels that are merged, is called a
*place* here. The same selection is applied to recordings (:func:`selected`) and to the layout of the sensor
(:func:`selected_layout`), and a checkpoint stores it, so that later recordings are read like those of the training.
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
"""Most digits of the number of a taxel in a text."""
SELECTING = ("merge_polarities", "only_taxels", "only_polarity", "merge_channels")
"""The options that make a selection."""
_SIZES = ("columns", "rows", "polarities")
"""The fields of :class:`RecordedChannels` that are the size of the sensor."""


class _Places(Frozen, eq=False):
    """The places that a selection makes.

    - ``taxels``: for each place, the 0-based numbers of the taxels that are merged into it
    - ``polarities``: the polarities that are kept, the same for every place
    """

    taxels: tuple[IntArray, ...]
    polarities: tuple[int, ...]

    @property
    def joins(self) -> bool:
        """Whether any place is made of several taxels."""
        return any(len(members) > 1 for members in self.taxels)

    @property
    def in_order(self) -> IntArray:
        """The numbers of all taxels that are read, place by place."""
        return np.concatenate(self.taxels)

    def are_all_of(self, taxels: int) -> bool:
        """Return whether the places are the ``taxels`` taxels of the sensor, each by itself, in their order."""
        return not self.joins and np.array_equal(self.in_order, np.arange(taxels))


def selected_layout(layout: SensorLayout, selection: ChannelSelection) -> SensorLayout:
    """Return the layout of the channels that a selection leaves, as if they were a sensor of their own.

    Raises ``InputError`` for a selection of taxels or polarities that the sensor does not have.
    """
    if selection.merge_polarities:
        layout = replace(layout, polarities=1)
    if selection.merges_polarities_at_most:
        return layout
    taxels = layout.surfaces * layout.taxels
    places = _places(selection, taxels, layout.polarities)
    polarities = len(places.polarities)
    if places.are_all_of(taxels):
        # Only the polarities change.
        return replace(layout, polarities=polarities)
    count = len(places.taxels)
    return SensorLayout(
        name=layout.name,
        taxels=count,
        polarities=polarities,
        # What remains of a row is a row. What remains of a grid is no grid any more.
        columns=count if layout.columns == taxels else None,
        positions=_positions(layout, places),
        names=_names(layout, places),
    )


def _positions(layout: SensorLayout, places: _Places) -> tuple[tuple[float, float], ...] | None:
    """Return where the places lie, each in the middle of its taxels; None if that is unknown, or if two coincide.

    Also None for a row, whose ``columns`` already say where its places lie.
    """
    taxel_positions = layout.places
    in_a_row = layout.columns == layout.taxels
    if taxel_positions is None or layout.surfaces > 1 or in_a_row:
        return None
    middles = [_middle(taxel_positions[members]) for members in places.taxels]
    return tuple(middles) if len(set(middles)) == len(middles) else None


def _middle(positions: FloatArray) -> tuple[float, float]:
    """Return the mean of (x, y) positions, (taxels, 2)."""
    x, y = positions.mean(axis=0)
    return float(x), float(y)


def _names(layout: SensorLayout, places: _Places) -> tuple[str, ...] | None:
    """Return the names of the taxels that are read; None if there are none, or if taxels are merged."""
    if layout.names is None or layout.surfaces > 1 or places.joins:
        return None
    return tuple(layout.names[taxel] for taxel in places.in_order)


def selected(
    recordings: Recordings, selection: ChannelSelection, merged_polarities: int
) -> Recordings:
    """Return recordings of the channels that a selection leaves.

    The caller has merged their polarities already if the selection asks for it; ``merged_polarities`` is how many the
    sensor had before. Raises ``InputError`` for recordings of which it is unknown which channel is which taxel, and for
    a selection that they do not have.
    """
    if selection == ChannelSelection():
        return recordings
    sensor = recordings.channels
    if sensor is None:
        what = "it is not known which channels belong to a taxel, so none can be picked or merged"
        fix = "Give --grid WxH, --layout FILE, or --channels N, with --polarities."
        raise InputError(f"recordings {recordings.source!r}", what, fix=fix)
    polarities = merged_polarities if selection.merge_polarities else sensor.polarities
    recorded = RecordedChannels(
        columns=sensor.columns, rows=sensor.rows, polarities=polarities, selection=selection
    )
    if selection.merges_polarities_at_most:
        # Where only events show how large the sensor is, another recording may show more of it, so
        # its size is not stored for later recordings.
        return recordings if sensor.reached else replace(recordings, recorded=recorded)
    places = _places(selection, sensor.pixels, sensor.polarities)
    channel_of_taxel = sensor.numbers().reshape(sensor.pixels, sensor.polarities)
    cells = channel_of_taxel[:, places.polarities]
    channels = [
        recordings.spikes[:, :, cells[members, number]].max(axis=2)
        for members in places.taxels
        for number in range(len(places.polarities))
    ]
    return replace(
        recordings,
        spikes=np.stack(channels, axis=2),
        channels=_channels(sensor, places),
        recorded=recorded,
    )


def _channels(sensor: Channels, places: _Places) -> Channels:
    """Return the places as pixels: the sensor's own if they are its taxels in their order, else a row of places."""
    polarities = len(places.polarities)
    if places.are_all_of(sensor.pixels):
        return Channels(sensor.columns, sensor.rows, polarities, reached=sensor.reached)
    return Channels(len(places.taxels), 1, polarities)


def selected_count(channels: int, polarities: int, selection: ChannelSelection) -> int:
    """Return how many channels a selection leaves of a sensor of ``channels`` with ``polarities`` per taxel.

    Raises ``InputError`` for a selection that it does not have.
    """
    places = _places(
        replace(selection, merge_polarities=False),
        channels // polarities,
        1 if selection.merge_polarities else polarities,
    )
    return len(places.taxels) * len(places.polarities)


def _places(selection: ChannelSelection, taxels: int, polarities: int) -> _Places:
    """Return the places that a selection makes of ``taxels`` taxels with ``polarities`` each."""
    numbers = np.arange(taxels)
    if selection.only_taxels is not None:
        numbers = taxel_numbers(selection.only_taxels, taxels)
    kept_polarities: tuple[int, ...] = tuple(range(polarities))
    if selection.only_polarity is not None:
        if polarities == 1:
            what = "the sensor has one polarity, so none can be picked"
            fix = "Leave it out, or add --polarities 2."
            raise InputError("only_polarity", what, fix=fix)
        kept_polarities = (selection.only_polarity,)
    if selection.merge_channels is None:
        one_taxel_each = tuple(numbers[:, np.newaxis])
        return _Places(one_taxel_each, kept_polarities)
    count = _merged_places(selection.merge_channels, len(numbers), len(kept_polarities))
    # As equal as possible: if the taxels do not divide evenly, the first places have one more.
    return _Places(tuple(np.array_split(numbers, count)), kept_polarities)


def _merged_places(channels: int, taxels: int, polarities: int) -> int:
    """Return the number of places whose ``polarities`` together are the ``channels`` that an option asks for.

    Raises ``InputError`` if these are more than the ``taxels`` have, or not a multiple of ``polarities``.
    """
    most = taxels * polarities
    fix = "Give fewer, or leave it out."
    check_most(channels, most, "merge_channels", "there are fewer channels to merge", fix=fix)
    count, remainder = divmod(channels, polarities)
    if remainder:
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
            # They cannot be different taxels any more; a longer list would only cost memory.
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
    """Return the selection that parsed options ask for: their attributes :data:`SELECTING`, None if not given."""
    values = picked(options, *SELECTING)
    return ChannelSelection(**values | {"merge_polarities": bool(values["merge_polarities"])})


def recorded_entries(recorded: RecordedChannels) -> dict[str, Any]:
    """Return a sensor and its selection as entries of the dict ``training`` of a checkpoint."""
    sizes = picked(recorded, *_SIZES)
    entries = {f"recorded_{name}": size for name, size in sizes.items()}
    return entries | picked(recorded.selection, *SELECTING)


def recorded_in(training: Mapping[str, Any], channels: int) -> RecordedChannels | None:
    """Return the sensor and selection in the ``training`` of a checkpoint, the inverse of :func:`recorded_entries`.

    None if there are none, if they make no sense, or if they do not leave the ``channels`` of the network.
    """
    sizes: dict[str, Any] = {name: training.get(f"recorded_{name}") for name in _SIZES}
    if None in sizes.values():
        return None
    values: dict[str, Any] = {name: training.get(name) for name in SELECTING}
    values["merge_polarities"] = values["merge_polarities"] is True
    # A checkpoint may come from a stranger, and these entries are only what it says of itself: if they
    # are wrong, recordings are read as they are.
    try:
        recorded = RecordedChannels(**sizes, selection=ChannelSelection(**values))
        remain = selected_count(recorded.count, recorded.polarities, recorded.selection)
    except InputError:
        return None
    return recorded if remain == channels else None
