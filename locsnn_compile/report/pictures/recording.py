"""Draw the events of one recording as a raster, in text and as SVG, with time to the right and channels downwards.

``locsnn events`` shows them. A large recording is drawn more coarsely: a block of several steps and channels
becomes one character or mark.
"""

import math

import numpy as np

from hw_model.values import ByteArray, FloatArray
from locsnn_compile.report.pictures.chart import sheet, soft_text

SHADES = " ░▒▓█"
"""Characters for blocks without events, and with more and more of them."""
TEXT_COLUMNS = 64
TEXT_ROWS = 20
"""Most characters of a line, and most lines of a text, chosen by hand to fit a terminal."""
PICTURE_COLUMNS = 1000
PICTURE_ROWS = 500
"""Most marks of a picture from left to right, and from top to bottom, chosen by hand: finer ones cannot be seen."""

# Sizes in pixels, chosen by hand: of the plot, and of the margins around it, which hold the texts.
_PLOT_WIDTH = 720
_PLOT_HEIGHT = 320
_LEFT = 56
_RIGHT = 20
_TOP = 40
_BOTTOM = 40


def text_raster(spikes: ByteArray) -> list[str]:
    """Return the lines of a raster of one recording (steps, channels).

    A character covers several steps and channels. It is blank without events, and darker the larger the share of bins
    with an event, relative to the darkest character. A bin is one channel in one step.
    """
    shares = _coarse(spikes, TEXT_COLUMNS, TEXT_ROWS)
    # In a recording without events, the largest share is 0.
    largest = float(shares.max()) or 1.0
    # Rounded up, so that a single event is not blank.
    levels = np.ceil(shares / largest * (len(SHADES) - 1)).astype(int)
    return ["".join(SHADES[level] for level in row) for row in levels]


def raster_svg(spikes: ByteArray, title: str, step_seconds: float | None) -> bytes:
    """Return a raster of one recording (steps, channels) as SVG; in a large one, a mark covers several bins."""
    steps, channels = spikes.shape
    end = f"step {steps}" if step_seconds is None else f"{steps * step_seconds:g} s"
    right = _LEFT + _PLOT_WIDTH
    bottom = _TOP + _PLOT_HEIGHT
    text_y = bottom + 20  # the baseline of the texts below the plot
    text_right = _LEFT - 8  # the end of the numbers of the first and the last channel
    inside = f"""\
<path class="events" d="{_path_of_events(spikes)}"/>
<rect class="outline" x="{_LEFT}" y="{_TOP}" width="{_PLOT_WIDTH}" height="{_PLOT_HEIGHT}"/>
{soft_text(_LEFT, text_y, "start", "0")}
{soft_text(right, text_y, "end", end)}
{soft_text(text_right, _TOP + 12, "end", "0")}
{soft_text(text_right, bottom, "end", str(channels - 1))}
{soft_text((_LEFT + right) / 2, text_y, "middle", "time; channels downwards")}
"""
    return sheet(right + _RIGHT, bottom + _BOTTOM, title, "raster.css", inside)


def _path_of_events(spikes: ByteArray) -> str:
    """Return a rectangle for every mark, as the commands of an SVG path."""
    has_event = _coarse(spikes, PICTURE_COLUMNS, PICTURE_ROWS) > 0
    rows, columns = has_event.shape
    width = _PLOT_WIDTH / columns
    height = _PLOT_HEIGHT / rows
    return "".join(
        f"M{_LEFT + column * width:.2f} {_TOP + row * height:.2f}"
        f"h{width:.2f}v{height:.2f}h{-width:.2f}z"
        for row, column in np.argwhere(has_event).tolist()
    )


def _coarse(spikes: ByteArray, most_columns: int, most_rows: int) -> FloatArray:
    """Return the share of bins with an event in each block of channels and steps, (rows, columns).

    ``spikes`` are (steps, channels); there are at most as many rows and columns as asked for.
    """
    steps, channels = spikes.shape
    steps_per_block = math.ceil(steps / most_columns)
    channels_per_block = math.ceil(channels / most_rows)
    columns = math.ceil(steps / steps_per_block)
    rows = math.ceil(channels / channels_per_block)
    # Padded with silence, so that the last blocks are as large as the others.
    padded = np.zeros((columns * steps_per_block, rows * channels_per_block))
    padded[:steps, :channels] = spikes
    blocks = padded.reshape(columns, steps_per_block, rows, channels_per_block)
    shares: FloatArray = blocks.mean(axis=(1, 3)).T
    return shares
