"""``docs/emit.md`` names every kind."""

from __future__ import annotations

from pathlib import Path

from locsnn_compile.backends import BENCH_KINDS
from locsnn_compile.backends.sanafe.rules import DELAY_MAX

PAGE = (Path(__file__).parents[2] / "docs/emit.md").read_text()


def test_every_kind_has_a_row():
    rows = [line for line in PAGE.splitlines() if line.startswith("| `")]
    for kind in BENCH_KINDS:
        assert any(f"`{kind}`" in row.split("|")[1] for row in rows), kind
    assert f"| delays above {DELAY_MAX} |" in PAGE
