"""Lists whose targets are told as steps: what is taken apart again is what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.rtl import images
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.steps import FURTHEST, NEAREST, in_steps
from tests.support import benches

PROGRAMS = benches.all_benches()


def walked(core: CoreProgram) -> list[tuple[int, ...]]:
    """Return the synapses of lists of steps, as stepped.sv takes them apart: source, half, target, delay, exponent, mantissa."""
    lists = core.tables["axons"]
    words = core.tables["synapses"]
    synapses = []
    for source, (start, length) in enumerate(zip(lists["start"], lists["length"], strict=True)):
        for half in (0, 1):
            place = lists["place"][source]
            exponent = lists["exponent"][source]
            for at in range(start, start + length):
                step, delay, mantissa = (
                    words[f"{name}{half}"][at] for name in ("step", "delay", "mantissa")
                )
                place += step - 1 if step else mantissa >> 3
                if step:
                    synapses.append((source, half, place, delay, exponent, mantissa))
                else:
                    exponent = mantissa & 7
    return sorted(synapses)


def told(core: CoreProgram) -> list[tuple[int, ...]]:
    """Return the same of lists whose targets are told in full."""
    lists = core.tables["axons"]
    words = core.tables["synapses"]
    synapses = []
    for source, (start, length) in enumerate(zip(lists["start"], lists["length"], strict=True)):
        for half in (0, 1):
            for at in range(start, start + length):
                fields = [
                    words[f"{name}{half}"][at]
                    for name in ("target", "delay", "exponent", "mantissa")
                ]
                if fields[2:] != [7, 0]:
                    synapses.append((source, half, *fields))
    return sorted(synapses)


@pytest.mark.parametrize("bits", [1, 3, 8])
@pytest.mark.parametrize("index", range(len(PROGRAMS)))
def test_steps_tell_the_synapses(index, bits):
    program, spikes = PROGRAMS[index]
    full = CoreProgram(program, spikes.shape[1], sizes=benches.SIZES)
    core = CoreProgram(program, spikes.shape[1], sizes=replace(benches.SIZES, step=bits))
    assert walked(core) == told(full)


@pytest.mark.parametrize(
    ("targets", "entries"),
    [
        ([0, 1, 2], [(1, 5), (2, 6), (2, 7)]),
        ([4, 4], [(1, 5), (1, 6)]),
        ([0, 6, 13], [(1, 5), (7, 6), (0, 8 * 7 + 2), (1, 7)]),
        ([0, FURTHEST], [(1, 5), (0, 8 * FURTHEST + 2), (1, 6)]),
        ([0, FURTHEST + 1], [(1, 5), (0, 8 * FURTHEST + 2), (0, 8 + 2), (1, 6)]),
    ],
    ids=["neighbours", "twice the same", "a gap", "a jump", "a jump too far"],
)
def test_what_a_list_is_made_of(targets, entries):
    many = len(targets)
    synapses = {
        "target": np.array(targets),
        "delay": np.zeros(many, dtype=np.int64),
        "exponent": np.full(many, 2),
        "mantissa": np.arange(many) + 5,
    }
    half, found, head = in_steps(np.zeros(many, dtype=np.int64), synapses, 3, 2)
    assert list(zip(found["step"], found["mantissa"], strict=True)) == entries
    assert half.tolist() == [0] * len(entries)
    assert {name: values.tolist() for name, values in head.items()} == {
        "place": [targets[0], 0],
        "exponent": [2, 0],
    }


def test_another_exponent_and_the_way_back_take_a_jump():
    synapses = {
        "target": np.array([40, 3]),
        "delay": np.zeros(2, dtype=np.int64),
        "exponent": np.array([6, 1]),
        "mantissa": np.array([-9, 9]),
    }
    half, entries, head = in_steps(np.array([1, 1]), synapses, 3, 1)
    back = 3 - 40 - NEAREST
    assert entries["step"].tolist() == [1, 0, 0, 1]
    assert entries["mantissa"].tolist() == [-9, 8 * NEAREST + 1, 8 * back + 1, 9]
    assert half.tolist() == [1] * 4
    assert [int(values[0]) for values in head.values()] == [40, 6]


def test_a_list_that_is_too_long_for_its_field_is_refused(monkeypatch):
    program, spikes = PROGRAMS[0]
    longest = CoreProgram(
        program, spikes.shape[1], sizes=replace(benches.SIZES, step=3)
    ).lengths.max()
    monkeypatch.setattr(images, "LENGTH_BITS", 1)
    CoreProgram(program, spikes.shape[1], sizes=benches.SIZES)
    with pytest.raises(hw.TargetError) as caught:
        CoreProgram(program, spikes.shape[1], sizes=replace(benches.SIZES, step=3))
    what = f"the open core has no list of more than 1 words where targets are told as steps ({longest})"
    assert str(caught.value) == f"program {program.name!r}: {what}. Simulate it instead."
