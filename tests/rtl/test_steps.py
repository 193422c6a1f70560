"""Lists whose targets are stored as steps: taken apart again, they hold the synapses of lists that store targets in full."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import hw_model as hw
from hw_model.rtl import images
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.steps import FURTHEST, NEAREST, in_steps
from tests.support import benches

PROGRAMS = benches.all_benches()
STEP_BITS = 3


class Synapse(NamedTuple):
    """A synapse of a list: ``half`` is the half of the words that it lies in."""

    source: int
    half: int
    target: int
    delay: int
    exponent: int
    mantissa: int


def list_words(core: CoreProgram) -> Iterator[tuple[int, range]]:
    """Yield every source, and the words of its list."""
    lists = core.tables["axons"]
    for source, (start, length) in enumerate(zip(lists["start"], lists["length"], strict=True)):
        yield source, range(start, start + length)


def synapses_of_steps(core: CoreProgram) -> list[Synapse]:
    """Return the synapses of lists whose targets are steps, taken apart as stepped.sv does."""
    heads = core.tables["axons"]
    words = core.tables["synapses"]
    synapses = []
    for source, list_range in list_words(core):
        for half in (0, 1):
            target = heads["place"][source]
            exponent = heads["exponent"][source]
            for word in list_range:
                step = words[f"step{half}"][word]
                delay = words[f"delay{half}"][word]
                mantissa = words[f"mantissa{half}"][word]
                if step:
                    target += step - 1
                    synapses.append(Synapse(source, half, target, delay, exponent, mantissa))
                else:
                    # A jump: six bits of distance, three of exponent.
                    target += mantissa >> 3
                    exponent = mantissa & 7
    return sorted(synapses)


def synapses_in_full(core: CoreProgram) -> list[Synapse]:
    """Return the synapses of lists whose targets are stored in full."""
    words = core.tables["synapses"]
    synapses = []
    for source, list_range in list_words(core):
        for half in (0, 1):
            for word in list_range:
                target = words[f"target{half}"][word]
                delay = words[f"delay{half}"][word]
                exponent = words[f"exponent{half}"][word]
                mantissa = words[f"mantissa{half}"][word]
                is_empty = (exponent, mantissa) == (7, 0)
                if not is_empty:
                    synapses.append(Synapse(source, half, target, delay, exponent, mantissa))
    return sorted(synapses)


@pytest.mark.parametrize("bits", [1, 3, 8])
@pytest.mark.parametrize("index", range(len(PROGRAMS)))
def test_steps_hold_the_same_synapses_as_targets_in_full(index, bits):
    program, spikes = PROGRAMS[index]
    full = CoreProgram(program, spikes.shape[1], sizes=benches.SIZES)
    core = CoreProgram(program, spikes.shape[1], sizes=replace(benches.SIZES, step=bits))
    assert synapses_of_steps(core) == synapses_in_full(full)


def jump(distance: int, exponent: int) -> tuple[int, int]:
    """Return the step and the mantissa of an entry that is a jump."""
    return 0, 8 * distance + exponent


EXPONENT = 2
"""Of all synapses below; their mantissas are 5, 6, 7, by target."""


@pytest.mark.parametrize(
    ("targets", "entries"),
    [
        ([0, 1, 2], [(1, 5), (2, 6), (2, 7)]),
        ([4, 4], [(1, 5), (1, 6)]),
        ([0, 6, 13], [(1, 5), (7, 6), jump(7, EXPONENT), (1, 7)]),
        ([0, FURTHEST], [(1, 5), jump(FURTHEST, EXPONENT), (1, 6)]),
        ([0, FURTHEST + 1], [(1, 5), jump(FURTHEST, EXPONENT), jump(1, EXPONENT), (1, 6)]),
    ],
    ids=["neighbours", "twice the same", "a gap", "a jump", "a jump too far"],
)
def test_the_entries_of_a_list_are_steps_and_jumps(targets, entries):
    count = len(targets)
    synapses = {
        "target": np.array(targets),
        "delay": np.zeros(count, dtype=np.int64),
        "exponent": np.full(count, EXPONENT),
        "mantissa": np.arange(count) + 5,
    }
    half_of_synapse = np.zeros(count, dtype=np.int64)
    half, fields, heads = in_steps(half_of_synapse, synapses, STEP_BITS, lists=2)
    assert list(zip(fields["step"], fields["mantissa"], strict=True)) == entries
    assert half.tolist() == [0] * len(entries)
    # The second list is empty.
    assert heads["place"].tolist() == [targets[0], 0]
    assert heads["exponent"].tolist() == [EXPONENT, 0]


def test_another_exponent_and_the_way_back_take_a_jump():
    synapses = {
        "target": np.array([40, 3]),
        "delay": np.zeros(2, dtype=np.int64),
        "exponent": np.array([6, 1]),
        "mantissa": np.array([-9, 9]),
    }
    half, fields, heads = in_steps(np.array([1, 1]), synapses, STEP_BITS, lists=1)
    remaining = 3 - 40 - NEAREST  # after the longest jump back
    entries = list(zip(fields["step"], fields["mantissa"], strict=True))
    assert entries == [(1, -9), jump(NEAREST, 1), jump(remaining, 1), (1, 9)]
    assert half.tolist() == [1] * 4
    assert (int(heads["place"][0]), int(heads["exponent"][0])) == (40, 6)


def test_a_list_that_is_too_long_for_its_field_is_refused(monkeypatch):
    program, spikes = PROGRAMS[0]
    rows = spikes.shape[1]
    stepped = replace(benches.SIZES, step=STEP_BITS)
    longest = CoreProgram(program, rows, sizes=stepped).lengths.max()
    monkeypatch.setattr(images, "LENGTH_BITS", 1)
    CoreProgram(program, rows, sizes=benches.SIZES)  # without steps, the field is longer
    with pytest.raises(hw.TargetError) as caught:
        CoreProgram(program, rows, sizes=stepped)
    what = f"the open core has no list of more than 1 words where targets are told as steps ({longest})"
    assert str(caught.value) == f"program {program.name!r}: {what}. Simulate it instead."
