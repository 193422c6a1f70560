"""The pages on emitters in the documentation agree with the code: every kind is named, and SANA-FE's longest delay."""

from __future__ import annotations

import re
from pathlib import Path

from locsnn_compile.backends.sanafe.rules import DELAY_MAX
from locsnn_compile.emitters import EMITTERS

REFERENCE = Path(__file__).parents[2] / "docs/reference"
PAGE = (REFERENCE / "emit.md").read_text()
SANA_FE_PAGE = (REFERENCE / "emit/sana-fe-and-lava.md").read_text()


def test_every_kind_is_explained():
    for emitter in EMITTERS:
        # In a code span, or in a command after --emit or after another kind.
        assert re.search(rf"(`|emit |[a-z] ){emitter.kind}\b", PAGE), emitter.kind


def test_the_longest_delay_of_sana_fe_is_that_of_the_code():
    assert f"| delays above {DELAY_MAX} |" in SANA_FE_PAGE
