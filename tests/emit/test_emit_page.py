"""``docs/reference/emit.md`` names every kind, and the page on SANA-FE its longest delay."""

from __future__ import annotations

import re
from pathlib import Path

from locsnn_compile.backends.sanafe.rules import DELAY_MAX
from locsnn_compile.emitters import EMITTERS

REFERENCE = Path(__file__).parents[2] / "docs/reference"
PAGE = (REFERENCE / "emit.md").read_text()
OF_SANA_FE = (REFERENCE / "emit/sana-fe-and-lava.md").read_text()


def test_every_kind_is_explained():
    for emitter in EMITTERS:
        assert re.search(rf"(`|emit |[a-z] ){emitter.kind}\b", PAGE), emitter.kind
    assert f"| delays above {DELAY_MAX} |" in OF_SANA_FE
