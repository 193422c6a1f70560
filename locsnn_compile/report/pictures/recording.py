"""Rasters of one recording as text and as SVG, with time to the right and channels downwards."""

import numpy as np

from hw_model.values import ByteArray, FloatArray
from locsnn_compile.report.pictures.chart import sheet, soft_text

SHADES = " ░▒▓█"
#: Largest text in characters, and largest picture in marks; larger recordings are drawn more coarsely.
TEXT_COLUMNS, TEXT_ROWS = 64, 20
PICTURE_COLUMNS, PICTURE_ROWS = 1000, 500

_LEFT, _TOP, _RIGHT, _BOTTOM = 56, 40, 20, 40
_PLOT_WIDTH, _PLOT_HEIGHT = 720, 320


def text_raster(spikes: ByteArray) -> list[str]:
    """Return the lines of a raster of one recording (steps, channels).

    A character covers several steps and channels. It is blank without events, and darker the larger the share of bins
    with an event, relative to the darkest character.
    """
    shares = _coarse(spikes, TEXT_COLUMNS, TEXT_ROWS)
    darkest = float(shares.max()) or 1.0
    shade = np.ceil(shares / darkest * (len(SHADES) - 1)).astype(int)
    return ["".join(SHADES[level] for level in row) for row in shade]


def raster_svg(spikes: ByteArray, title: str, step_seconds: float | None) -> bytes:
    """Return a raster of one recording (steps, channels) as SVG; in a large one, a mark covers several bins."""
    steps, channels = spikes.shape
    marks = _coarse(spikes, PICTURE_COLUMNS, PICTURE_ROWS) > 0
    rows, columns = marks.shape
    dx = _PLOT_WIDTH / columns
    dy = _PLOT_HEIGHT / rows
    path = "".join(
        f"M{_LEFT + column * dx:.2f} {_TOP + row * dy:.2f}h{dx:.2f}v{dy:.2f}h{-dx:.2f}z"
        for row, column in np.argwhere(marks).tolist()
    )
    end = f"step {steps}" if step_seconds is None else f"{steps * step_seconds:g} s"
    right = _LEFT + _PLOT_WIDTH
    bottom = _TOP + _PLOT_HEIGHT
    inside = f"""\
<path class="events" d="{path}"/>
<rect class="outline" x="{_LEFT}" y="{_TOP}" width="{_PLOT_WIDTH}" height="{_PLOT_HEIGHT}"/>
{soft_text(_LEFT, bottom + 20, "start", "0")}
{soft_text(right, bottom + 20, "end", end)}
{soft_text(_LEFT - 8, _TOP + 12, "end", "0")}
{soft_text(_LEFT - 8, bottom, "end", str(channels - 1))}
{soft_text((_LEFT + right) / 2, bottom + 20, "middle", "time; channels downwards")}
"""
    return sheet(right + _RIGHT, bottom + _BOTTOM, title, "raster.css", inside)


def _coarse(spikes: ByteArray, columns: int, rows: int) -> FloatArray:
    """Return the share of bins with an event for at most (rows, columns) blocks of (steps, channels)."""
    steps, channels = spikes.shape
    steps_a_block = -(-steps // columns)
    channels_a_block = -(-channels // rows)
    block_columns = -(-steps // steps_a_block)
    block_rows = -(-channels // channels_a_block)
    padded = np.zeros((block_columns * steps_a_block, block_rows * channels_a_block))
    padded[:steps, :channels] = spikes
    blocks = padded.reshape(block_columns, steps_a_block, block_rows, channels_a_block)
    shares: FloatArray = blocks.mean(axis=(1, 3)).T
    return shares
