"""The text of every level of compiling a small network, compared with golden files.

Levels are the network as trained, in integers, as compartments, placed on cores, and so on. For other strategies and
neurons only the levels that differ have files. After an intended change, ``python tests/compiler/test_level_texts.py``
writes all files again; read the difference.
"""

from pathlib import Path

import pytest

import hw_model as hw
from locsnn_compile.emitters import LEVEL_KINDS
from locsnn_compile.pipeline import LEVEL_TEXTS, lower
from locsnn_compile.settings import STRATEGIES

GOLDEN = Path(__file__).parent / "golden"
OWN_LEVELS = ("network", "quantized", "compartments")
"""Levels whose texts differ between strategies and kinds of neurons."""


def levels(case):
    """Return the levels of a case: a strategy, or a kind of neuron (``cuba``, ``on-grid``)."""
    from locsnn_compile.network.neurons import Cuba
    from tests.support.networks import hybrid, on_grid, single

    if case == "cuba":
        neuron = Cuba.of(
            3,
            decay_u=0.3,
            decay_v=0.1,
            threshold=[0.5, 1.0, 2.0],
            bias=[0.0, 0.1, -0.2],
            refractory=2,
        )
        network = single(
            neuron,
            [[0.1, -0.5], [0.7, 0.25], [0.0, 1.0]],
            recurrent=[[0.0] * 3] * 2 + [[0.5] * 3],
            delay=3,
        )
    else:
        network = on_grid(1) if case == "on-grid" else hybrid()
    return lower(
        network,
        hw.chip("loihi-sim"),
        weight_bits=8,
        strategy=case if case in STRATEGIES else "dendrite",
    )


def cases():
    """Return (case, level, golden file) for all texts."""
    rows = [("dendrite", kind, f"{kind}.txt") for kind in LEVEL_KINDS]
    # Strategies start from the same network, so its text is compared once.
    for strategy in ("delay-line", "reset", "paired-dendrite"):
        for kind in OWN_LEVELS[1:]:
            rows.append((strategy, kind, f"{strategy}-{kind}.txt"))
    for neurons in ("cuba", "on-grid"):
        for kind in OWN_LEVELS:
            rows.append((neurons, kind, f"{neurons}-{kind}.txt"))
    return rows


CASES = cases()


@pytest.mark.parametrize(("case", "kind", "file"), CASES, ids=[file for *_, file in CASES])
def test_level_text(case, kind, file):
    assert LEVEL_TEXTS[kind](levels(case)) == (GOLDEN / file).read_text()


def test_every_level_has_a_text():
    assert tuple(LEVEL_TEXTS) == LEVEL_KINDS


if __name__ == "__main__":
    for case, kind, file in CASES:
        (GOLDEN / file).write_text(LEVEL_TEXTS[kind](levels(case)))
