"""Our Xylo against xylosim, on random networks: every register of every row."""

from __future__ import annotations

import pytest
from make_environments import python_of, why_missing

from hw_model.xylo.fast import play_fast
from hw_model.xylo.reference import play_xylo
from tests.support.random_xylo import random_xylo
from tests.support.witness_files import REGISTERS
from tests.xylo.record import ask_witness, compiled_cases

pytestmark = pytest.mark.peers

SEEDS = range(1000, 2000)
TOGETHER = 100
"""Networks that xylosim is given at a time."""


def test_a_thousand_networks_play_as_in_xylosim(tmp_path):
    reason = why_missing("xylosim")
    if reason:
        pytest.skip(f"xylosim: {reason}")
    values = 0
    spikes = 0
    saturated = 0
    for first in range(SEEDS.start, SEEDS.stop, TOGETHER):
        seeds = range(first, first + TOGETHER)
        cases = [random_xylo(seed) for seed in seeds]
        witnesses = ask_witness(python_of("xylosim"), cases, tmp_path)
        for seed, (network, events), witness in zip(seeds, cases, witnesses, strict=True):
            result, plain = (play(network, events) for play in (play_fast, play_xylo))
            for name in REGISTERS:
                assert (getattr(result, name) == witness[name]).all(), (seed, name)
                assert (getattr(plain, name) == witness[name]).all(), (seed, name)
                values += witness[name].size
            spikes += int(result.spikes.sum())
            saturated += result.events["current_saturations"]
    print(
        f"\nxylosim: {len(SEEDS)} programs, {values:,} values, 0 differ "
        f"({spikes:,} hidden spikes, {saturated:,} saturated currents)"
    )
    assert spikes > 500_000
    assert saturated > 500_000


def test_compiled_networks_play_as_in_xylosim(tmp_path):
    reason = why_missing("xylosim")
    if reason:
        pytest.skip(f"xylosim: {reason}")
    cases = compiled_cases()
    witnesses = ask_witness(python_of("xylosim"), cases, tmp_path)
    for (network, events), witness in zip(cases, witnesses, strict=True):
        result = play_fast(network, events)
        for name in REGISTERS:
            assert (getattr(result, name) == witness[name]).all(), name
