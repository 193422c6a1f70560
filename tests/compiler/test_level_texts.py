"""Every level of one small network as text, compared with golden files; of other strategies the levels that differ.

After a wanted change: ``python tests/compiler/test_level_texts.py`` writes them anew; read the difference.
"""

from pathlib import Path

import pytest

import hw_model as hw
from locsnn_compile.emitters import LEVEL_KINDS
from locsnn_compile.pipeline import LEVEL_TEXTS, lower
from locsnn_compile.settings import STRATEGIES

GOLDEN = Path(__file__).parent / "golden"
OWN_LEVELS = ("network", "quantized", "compartments")


def levels(case):
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


CASES = [
    *(("dendrite", kind, f"{kind}.txt") for kind in LEVEL_KINDS),
    *(
        (case, kind, f"{case}-{kind}.txt")
        for case in ("delay-line", "reset", "paired-dendrite", "cuba", "on-grid")
        for kind in OWN_LEVELS
        if kind != "network" or case in ("cuba", "on-grid")
    ),
]


@pytest.mark.parametrize(("case", "kind", "file"), CASES, ids=[file for *_, file in CASES])
def test_level_text(case, kind, file):
    assert LEVEL_TEXTS[kind](levels(case)) == (GOLDEN / file).read_text()


def test_every_level_has_a_text():
    assert tuple(LEVEL_TEXTS) == LEVEL_KINDS


if __name__ == "__main__":
    for case, kind, file in CASES:
        (GOLDEN / file).write_text(LEVEL_TEXTS[kind](levels(case)))
