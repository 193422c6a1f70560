"""Operations and arithmetic energy of conventional networks, worked out by hand.

They classify 36 objects from recordings of two fingertips (156 channels) over 325 steps.
"""

import pytest

from locsnn_compile.baselines.operations import AnnCounts, ann_counts, ann_energy_pj
from locsnn_compile.data.sensor import neutouch


@pytest.mark.parametrize(
    ("name", "counts", "pj"),
    [
        (
            "cnn-3d",
            # half of the published 8,340,480 operations
            AnnCounts(macs=4_170_240, multiplications=4_170_240, additions=4_170_240),
            # a MAC: 3.7 + 0.9, 0.2 + 0.03 and 0.2 + 0.1 pJ
            {"fp32": 19_183_104.0, "int8": 959_155.2, "int8_sums_of_32_bits": 1_251_072.0},
        ),
        (
            "gru-mlp",
            # 325 * 3 * (156 * 32 + 32 * 32) + 32 * 36 MACs; 325 * 32 times 3 products and 10 sums more: 11,868,704
            AnnCounts(macs=5_866_752, multiplications=5_897_952, additions=5_970_752),
            {"fp32": 27_196_099.2, "int8": 1_358_712.96, "int8_sums_of_32_bits": 1_776_665.6},
        ),
    ],
    ids=["cnn-3d", "gru-mlp"],
)
def test_counts_and_energies_are_those_worked_out_by_hand(name, counts, pj):
    counted = ann_counts(name, sensor=neutouch(2), steps=325, classes=36)
    assert counted == counts
    assert ann_energy_pj(counted) == pytest.approx(pj, rel=0, abs=5e-7)
