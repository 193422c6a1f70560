"""The cores of a chip on its mesh, each filled from below as far as it is used."""

from __future__ import annotations

from locsnn_compile.report.content import Mesh
from locsnn_compile.report.pictures.svg import framed, percent, words_of

_CORE, _GAP = 26, 5
"""Pixels down: of a core, and between tiles."""


def mesh(drawn: Mesh) -> str:
    """Return tiles of cores; the number in a core is its use in percent."""
    wide = 100 / drawn.columns
    gap = wide * 0.08
    core_wide = (wide - gap) / drawn.tile_columns
    tile_high = _CORE * drawn.tile_rows + _GAP
    parts = []
    for row in range(drawn.rows):
        for column in range(drawn.columns):
            left, top = column * wide + gap / 2, row * tile_high
            parts.append(_rect("tile", left, top, wide - gap, _CORE * drawn.tile_rows))
    for core in drawn.cores:
        tile_column, within_column = divmod(core.column, drawn.tile_columns)
        tile_row, within_row = divmod(core.row, drawn.tile_rows)
        left = tile_column * wide + gap / 2 + within_column * core_wide
        top = tile_row * tile_high + within_row * _CORE
        filled = max(2.0, core.share * _CORE)
        parts.append(_rect("core", left, top, core_wide, _CORE))
        parts.append(_rect("fill", left, top + _CORE - filled, core_wide, filled))
        x, y = percent(left + core_wide / 2), f"{top + 17:g}"
        parts.append(f'<text class="value" text-anchor="middle" x="{x}" y="{y}">{words_of(core.text)}</text>')
    height = drawn.rows * tile_high
    return framed("mesh", height, drawn.title, drawn.description, "".join(parts))


def _rect(kind: str, left: float, top: float, width: float, height: float) -> str:
    return f'<rect class="{kind}" x="{percent(left)}" y="{top:g}" width="{percent(width)}" height="{height:g}"/>'
