"""A bar in a cell, and one bar cut into the shares of a whole."""

from __future__ import annotations

from locsnn_compile.report.content import Bar, Stack
from locsnn_compile.report.pictures.patterns import fill
from locsnn_compile.report.pictures.svg import percent, words_of


def bar(cell: Bar) -> str:
    """Return a track filled to the cell's share."""
    return (
        f'<svg class="bar" width="100%" height="10" role="img" aria-label="{words_of(cell.label)}">'
        f'<rect class="track" width="100%" height="10"/>{_part(0.0, cell.share, cell.pattern, 10)}</svg>'
    )


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    parts, start = [], 0.0
    for part in drawn.shares:
        parts.append(_part(start, part.share, part.pattern, 28))
        start += part.share
    label = words_of(f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}")
    return (
        f'<svg class="stack" width="100%" height="28" role="img" aria-label="{label}">'
        f'<rect class="track" width="100%" height="28"/>{"".join(parts)}</svg>'
    )


def _part(start: float, share: float, pattern: int, height: int) -> str:
    if share <= 0:
        return ""
    return (
        f'<rect class="part" x="{percent(100 * start)}" width="{percent(100 * min(share, 1.0))}" '
        f'height="{height}" fill="{fill(pattern)}"/>'
    )
