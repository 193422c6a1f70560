"""Only the modules of the chip's arithmetic know its units, the bounds of its registers, and when a spike acts.

`units_in` searches the source of every other module for places that compute such a thing again. The
second half of these tests shows that it finds planted cases and passes over innocent numbers.
"""

from pathlib import Path

import pytest
from units import units_in

ROOT = Path(__file__).parents[2]
NOT_SEARCHED = ("hw_model/arithmetic/", "locsnn_compile/data/")
"""The arithmetic itself, and readers of recordings: these know no chip, and bit fields of files have any width."""
MODULES = [
    path
    for folder in ("hw_model", "locsnn_compile")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if not path.relative_to(ROOT).as_posix().startswith(NOT_SEARCHED)
]
OTHER_NUMBERS = {
    "hw_model/description/open_core.py": ["compares v <= 64"],
    "hw_model/streaming/location_phase.py": ["computes history.event_step[e] + 1 + delay"],
    "locsnn_compile/frontends/nir/signals.py": ["computes delay + 1"],
    "locsnn_compile/reference/evaluate.py": ["computes delay + 1", "computes delay + 1"],
}
"""Places that only look like units of the chip, in this order: the width in bits of a register of the
open core, a row of a buffer in a compiled loop, and delays of networks, which `Projection` defines."""


def test_no_module_outside_the_arithmetic_computes_with_its_units():
    uses_by_module = {}
    for path in MODULES:
        # Without the number of the line, which changes with every edit.
        uses = [use.partition(": ")[2] for use in units_in(path.read_text())]
        if uses:
            uses_by_module[str(path.relative_to(ROOT))] = uses
    assert uses_by_module == OTHER_NUMBERS


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
        (
            "half = 1 << chip.registers.charge_bits",
            "line 1: computes 1 << chip.registers.charge_bits",
        ),
        ("last = 2**voltage_bits - 1", "line 1: computes 2 ** voltage_bits"),
        ("rooms = [1 << bits for bits in widths]", "line 1: computes 1 << bits"),
        ("floors = [1 - (1 << k) for k in range(8)]", "line 1: computes 1 - (1 << k)"),
        ("vmin = 1 - 2**k", "line 1: computes 1 - 2 ** k"),
        ("charge[:, 1 + synapse.delay :] += due", "line 1: computes 1 + synapse.delay"),
        ("at = row + 1 + delay", "line 1: computes row + 1 + delay"),
        (
            "units = np.floor(mantissa * 2.0**projection.exponent)",
            "line 1: computes np.floor(mantissa * 2.0 ** projection.exponent)",
        ),
    ],
)
def test_a_planted_unit_is_found(planted, use):
    assert units_in(planted) == [use]


@pytest.mark.parametrize(
    "innocent",
    [
        "cache_line = 64",
        "most_bytes = 64 << 20",
        "x = y + 65",
        "slots = 1 << slot_bits",
        "rest = x - (1 << k)",
        "late = delay + 2",
        "share = np.floor(x * 2.0**level)",
    ],
)
def test_other_numbers_are_not_taken_for_units(innocent):
    assert units_in(innocent) == []
