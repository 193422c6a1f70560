"""Which pixel and which polarity a channel is, and how recordings and the inputs of a network number channels.

A pixel of an event camera, or a taxel of a tactile sensor, has one or two polarities (brighter and
darker, or rising and falling pressure), and each is a channel.

Two numberings are in use, named by their axes from the slowest to the fastest:

    yxp    polarities * (columns * y + x) + p         this project's files and layouts
    pyx    columns * rows * p + columns * y + x       networks over images (C, H, W)
"""

import math
from typing import Literal

import numpy as np

from hw_model.values import AnyArray, Frozen, IntArray, sealed
from locsnn_compile.errors import InputError, check_known

Numbering = Literal["yxp", "pyx"]
NUMBERINGS: tuple[Numbering, ...] = ("yxp", "pyx")
IMAGE_AXES = 3
"""Axes of an image: (C, H, W)."""


class Channels(Frozen):
    """Channels that are pixels: ``columns`` x ``rows`` of them, each with ``polarities``.

    - Taxels that have no rows are a grid of one row.
    - ``numbering``: see the module
    - ``reached``: whether the size is only as large as the pixels that have events, so that the sensor may be larger
    - ``polarity``: the only polarity that occurs in the events, if nothing says how many polarities the sensor has.
      ``polarities`` is then 1, although the sensor may have two.
    """

    columns: int
    rows: int = 1
    polarities: int = 1
    numbering: Numbering = "yxp"
    reached: bool = False
    polarity: int | None = None

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.columns * self.rows

    @property
    def count(self) -> int:
        """Number of channels."""
        return self.pixels * self.polarities

    @property
    def is_grid(self) -> bool:
        """Whether pixels have a row and a column, and not only a number."""
        return self.rows > 1

    @property
    def words(self) -> str:
        """The size, as messages show it: ``34 x 34 pixels of 2 polarities``."""
        size = f"{self.columns} x {self.rows} pixels" if self.is_grid else f"{self.columns} places"
        polarities = "1 polarity" if self.polarities == 1 else f"{self.polarities} polarities"
        return f"{size} of {polarities}"

    @property
    def formula(self) -> str:
        """The number of a channel, as sentences show it."""
        if self.numbering == "pyx":
            return f"{self.pixels} * polarity + {self.columns} * y + x"
        return f"{self.polarities} * ({self.columns} * y + x) + polarity"

    def numbers(self) -> IntArray:
        """Return the channel of each pixel and polarity, (rows, columns, polarities)."""
        channels = np.arange(self.count)
        if self.numbering == "pyx":
            images = channels.reshape(self.polarities, self.rows, self.columns)
            return images.transpose(1, 2, 0)
        return channels.reshape(self.rows, self.columns, self.polarities)

    def places_in(self, sensor: "Channels") -> IntArray:
        """Return for each channel of these pixels its number in ``sensor``, (count,).

        ``sensor`` is a sensor of at least this size, with the same pixel (0, 0) and any numbering. If these events have
        a single polarity (see ``polarity``) and ``sensor`` has two, they become events of that polarity.
        """
        first = 0
        if sensor.polarities > 1 and self.polarity is not None:
            first = self.polarity
        corner = sensor.numbers()[: self.rows, : self.columns, first : first + self.polarities]
        places = np.empty(self.count, dtype=np.int64)
        places[self.numbers().ravel()] = corner.ravel()
        return sealed(places)


def image_channels(shape: tuple[int, ...]) -> Channels | None:
    """Return the channels of a network's input of shape (C, H, W), where C counts polarities.

    Leading axes of one entry, such as that of a batch, are ignored. None for a shape that is not an image: one with
    other axes, or with a single pixel.
    """
    axes = tuple(shape)
    while len(axes) > IMAGE_AXES and axes[0] == 1:
        axes = axes[1:]
    if len(axes) != IMAGE_AXES or math.prod(axes[1:]) == 1:
        return None
    polarities, rows, columns = axes
    return Channels(columns, rows, polarities, "pyx")


def flat_channels(
    count: int, polarities: int | None, columns: int | None, numbering: Numbering | None, where: str
) -> Channels | None:
    """Return ``count`` channels as pixels of ``polarities``, in a grid of ``columns``, or in one row if None.

    None if ``polarities`` is None, because then nothing says what the channels are; ``InputError`` if the numbers do
    not make whole rows.
    """
    if polarities is None:
        return None
    row = polarities * (columns or 1)
    if row < 1 or count % row:
        what = "its channels are not those of whole rows"
        measured = f"{count} of {columns or 1} columns and {polarities} polarities"
        raise InputError(where, what, measured=measured, fix="Compile again.")
    rows = count // row
    size = (columns, rows) if columns else (rows, 1)
    return Channels(*size, polarities, numbering or "yxp")


def parse_numbering(text: str | None) -> Numbering | None:
    """Return a numbering by its name; ``InputError`` for other names."""
    check_known(f"channel order {text!r}", "it is not known", text, NUMBERINGS)
    return text  # type: ignore[return-value]


def frames_as_channels(array: AnyArray) -> tuple[AnyArray, Channels | None]:
    """Return frames (samples, steps, polarities, rows, columns) as (samples, steps, channels), and their pixels.

    Arrays with another number of axes are returned unchanged, with None: nothing says which pixels their channels are.
    """
    if array.ndim != 2 + IMAGE_AXES or 0 in array.shape:
        return array, None
    samples, steps, polarities, rows, columns = array.shape
    pixels = Channels(columns, rows, polarities, "pyx")
    return array.reshape(samples, steps, pixels.count), pixels
