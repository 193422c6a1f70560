"""Proven ranges against interval arithmetic: intervals contain every run, and the closed-form ranges contain them.

:mod:`tests.support.intervals` runs the step of the arithmetic on intervals instead of integers.
"""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from tests.support.intervals import CoreIntervals
from tests.support.random_programs import SMALL, random_program


@pytest.mark.parametrize("seed", range(12))
def test_no_run_leaves_its_intervals_and_no_interval_leaves_the_proof(seed):
    program, _, _, spikes = random_program(seed, SMALL)
    result = hw.simulate(program, spikes, engine="reference", probe=("u", "v"))
    registers = program.chip.registers
    for core, proven in zip(program.cores, hw.prove_range(program), strict=True):
        state = CoreIntervals(core, registers)
        cannot_wrap = proven.cannot_wrap
        for step in range(len(spikes)):
            state.step()
            u = np.concatenate([result.u[p.group][step, p.start : p.stop] for p in core.slices])
            v = np.concatenate([result.v[p.group][step, p.start : p.stop] for p in core.slices])
            assert state.u.holds(u), (core.number, step)
            assert state.v.holds(v), (core.number, step)
            assert (state.u.low[cannot_wrap] >= proven.u.low[cannot_wrap]).all()
            assert (state.u.high[cannot_wrap] <= proven.u.high[cannot_wrap]).all()
            assert (state.v.high <= np.maximum(proven.v.high, 0)).all()
            assert (state.v.low >= np.minimum(proven.v.low, 0)).all()
