"""The units of decays and weights stand on the page of the arithmetic, and nowhere else."""

from pathlib import Path

import pytest
from units import units_in

ROOT = Path(__file__).parents[2]
MODULES = [
    path
    for folder in ("hw_model", "locsnn_compile")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if "arithmetic" not in path.relative_to(ROOT).parts
]
OTHER_NUMBERS = {
    "hw_model/description/open_core.py": ["compares v <= 64"],
}
"""What is a 64 of another kind: bits of a register of the open core."""


def test_no_module_outside_the_page_computes_with_a_unit():
    found = {}
    for path in MODULES:
        uses = [use.partition(": ")[2] for use in units_in(path.read_text())]
        if uses:
            found[str(path.relative_to(ROOT))] = uses
    assert found == OTHER_NUMBERS


@pytest.mark.parametrize(
    ("planted", "use"),
    [
        ("keep = 4096 - decay", "line 1: computes 4096 - decay"),
        ("share = decay / 4096", "line 1: computes decay / 4096"),
        ("low = x & 4095", "line 1: computes x & 4095"),
        ("left = (x * keep) >> 12", "line 1: computes x * keep >> 12"),
        ("v = threshold << 6", "line 1: computes threshold << 6"),
        ("fires = v > 64.0 * threshold", "line 1: computes 64.0 * threshold"),
        ("threshold *= 64", "line 1: computes threshold *= 64"),
        ("charge >>= 6", "line 1: computes charge >>= 6"),
        ("if decay == 4096:\n    pass", "line 1: compares decay == 4096"),
        ("soma = add('soma', decay_u=4096)", "line 1: gives decay_u=4096"),
        (
            "from hw_model.arithmetic.fixed_point import DECAY_ONE",
            "line 1: imports DECAY_ONE",
        ),
        ("import loihi\nunit = 1 << loihi.WEIGHT_SHIFT", "line 2: uses loihi.WEIGHT_SHIFT"),
    ],
)
def test_a_planted_unit_is_found(planted, use):
    assert units_in(planted) == [use]


@pytest.mark.parametrize("innocent", ["cache_line = 64", "most_bytes = 64 << 20", "x = y + 65"])
def test_other_numbers_are_not_taken_for_units(innocent):
    assert units_in(innocent) == []
