"""Every level of one small network as text, compared with golden files.

After a wanted change: ``python tests/compiler/test_level_texts.py`` writes them anew; read the difference.
"""

from pathlib import Path

import pytest

import hw_model as hw
from locsnn_compile.cli.compile import LEVEL_KINDS
from locsnn_compile.level_text import LEVEL_TEXTS
from locsnn_compile.pipeline import lower

GOLDEN = Path(__file__).parent / "golden"


def levels():
    from networks import hybrid

    return lower(hybrid(), hw.chip("loihi-sim"), 8)


@pytest.mark.parametrize("kind", LEVEL_KINDS)
def test_level_text(kind):
    assert LEVEL_TEXTS[kind](levels()) == (GOLDEN / f"{kind}.txt").read_text()


def test_every_level_has_a_text():
    assert tuple(LEVEL_TEXTS) == LEVEL_KINDS


if __name__ == "__main__":
    for kind, text in LEVEL_TEXTS.items():
        (GOLDEN / f"{kind}.txt").write_text(text(levels()))
