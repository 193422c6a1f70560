"""The patterns that tell the parts of a whole apart."""

from __future__ import annotations

_PATTERNS = (
    '<rect width="8" height="8" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M-2 10L10 -2M-2 2L2 -2M6 10L10 6" class="line"/>',
    '<rect width="8" height="8" class="paper"/><circle cx="2" cy="2" r="1.3" class="ink"/>'
    '<circle cx="6" cy="6" r="1.3" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M0 2H8M0 6H8" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M-2 -2L10 10M-2 10L10 -2" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M2 0V8M6 0V8" class="line"/>',
)


def patterns() -> str:
    """Return the definitions that the other drawings refer to; once a page."""
    made = "".join(
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{body}</pattern>'
        for i, body in enumerate(_PATTERNS)
    )
    return f'<svg class="defs" width="0" height="0" aria-hidden="true" focusable="false"><defs>{made}</defs></svg>'


def fill(pattern: int) -> str:
    """Return how a shape refers to a pattern; there are few, so they come again."""
    return f"url(#p{pattern % len(_PATTERNS)})"
