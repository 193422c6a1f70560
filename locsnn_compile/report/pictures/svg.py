"""What all pictures share: escaped words, places in percent, the frame with its name and description, axes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from locsnn_compile.report.format import plain

AXIS_HEIGHT = 38
"""Pixels that the horizontal axis takes below a picture: ticks, their texts and the label."""


def words_of(text: str) -> str:
    """Return a string safe in text and in quoted attributes."""
    return escape(plain(text))


def percent(value: float) -> str:
    """Return a place across."""
    return f"{value:.2f}%"


def framed(kind: str, height: int, title: str, description: str, body: str) -> str:
    """Return a picture that names and describes itself to who cannot see it."""
    return (
        f'<svg class="{kind}" width="100%" height="{height}" role="img"><title>{words_of(title)}</title>'
        f"<desc>{words_of(description)}</desc>{body}</svg>"
    )


def stretched(top: int, height: int, view_box: str, body: str) -> str:
    """Return a part whose own units are stretched to the width of the picture; strokes are not, if they say so."""
    return (
        f'<svg x="0%" y="{top}" width="100%" height="{height}" viewBox="{view_box}" preserveAspectRatio="none" '
        f'aria-hidden="true">{body}</svg>'
    )


def horizontal_axis(bottom: int, ticks: Sequence[tuple[float, str]], label: str) -> str:
    """Return ticks at places 0..1 with their texts, and the label below them."""
    parts = []
    for at, text in ticks:
        anchor = "start" if at < 0.03 else "end" if at > 0.97 else "middle"
        x = percent(100 * at)
        parts.append(f'<line class="axis" x1="{x}" x2="{x}" y1="{bottom}" y2="{bottom + 4}"/>')
        parts.append(f'<text class="tick" text-anchor="{anchor}" x="{x}" y="{bottom + 17}">{words_of(text)}</text>')
    parts.append(f'<text class="tick" text-anchor="middle" x="50%" y="{bottom + 33}">{words_of(label)}</text>')
    return "".join(parts)
