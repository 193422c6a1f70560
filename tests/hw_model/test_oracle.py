"""Both engines against the oracle, on random programs of everything that a chip file and the builder allow.

The oracle, :mod:`tests.support.loihi_oracle`, is a second implementation in plain Python. It reads the graph of
compartments, not the program, so mapping to cores is tested as well.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.simulation import ENGINES
from tests.support import any_phases, any_program
from tests.support import loihi_oracle as oracle
from tests.support.against_oracle import check_oracle, check_played, play_all
from tests.support.any_program import SETTINGS
from tests.support.register_units import FORGETS_AT_ONCE, UNIT

LARGE = (1, 9)
"""Seeds of large programs, which take the plain engine long."""
SEEDS = [seed for seed in range(36) if seed not in LARGE]
EXAMPLES = hypothesis_settings(SETTINGS, max_examples=20)


@cache
def played_by_oracle(seed: int) -> list[oracle.Played]:
    """Return what the oracle computes for each recording of a seed; cached, as both engines are compared with it."""
    case = any_phases.case(seed)
    return play_all(case.graph, case.program.chip, case.spikes, case.steps)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("seed", SEEDS)
def test_programs_of_several_phases_equal_the_oracle(engine, seed):
    case = any_phases.case(seed)
    check_played(case.program, case.spikes, case.steps, engine, played_by_oracle(seed))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@EXAMPLES
@given(any_program.programs())
def test_any_program_equals_the_oracle(engine, drawn):
    check_oracle(drawn.program, drawn.graph, {"x": drawn.spikes}, None, engine)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@EXAMPLES
@given(any_program.hybrid_programs())
def test_any_hybrid_equals_the_oracle(engine, drawn):
    check_oracle(drawn.program, drawn.graph, {"touch": drawn.spikes}, None, engine)


def test_the_seeds_meet_everything_that_the_builder_allows():
    """Every kind of join, input, phase, delay, limit and event occurs in some seed, so none goes untested."""
    met: Counter[str] = Counter()
    for seed in SEEDS:
        case = any_phases.case(seed)
        groups = case.graph.groups
        parents = {group.name: group.joined_to for group in groups}
        met["joined"] += any(parents.values())
        met["chains"] += any(parents.get(parent) for parent in parents.values() if parent)
        met["fans"] += max(Counter(filter(None, parents.values())).values(), default=0) > 1
        met["several phases"] += len(case.graph.phases) > 1
        met["late starts"] += any(p.align_events is not None for p in case.graph.phases)
        met["several inputs"] += len(case.graph.inputs) > len(case.graph.phases)
        met["transposed"] += any(item.positions is not None for item in case.graph.inputs)
        met["several delays"] += any(len(set(s.delay.tolist())) > 1 for s in case.graph.synapses)
        met["negative exponents"] += any(s.exponent < 0 for s in case.graph.synapses)
        met["refractory"] += any((group.refractory > 1).any() for group in groups)
        met["biases"] += any(group.bias_mantissa.any() for group in groups)
        usual = case.program.chip.registers.voltage_max
        met["narrow voltages"] += any((group.vmax < usual).any() for group in groups)
        met["several cores"] += len(case.program.cores) > len(case.graph.phases)
        met["potentials read"] += bool(case.graph.readout.from_step)
        for played in played_by_oracle(seed):
            for counts in played.events.values():
                met.update(counts)
    assert [name for name, count in met.items() if not count] == []
    assert set(oracle.EVENTS) <= met.keys()


def test_the_oracle_plays_a_step_by_hand():
    """One compartment, by hand: a charge, of which half is left after each step, a spike with its reset, a blocked step."""
    charge = 10 * UNIT
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 1)
    n = builder.add_compartments(
        "n", 1, decay_u=FORGETS_AT_ONCE // 2, decay_v=FORGETS_AT_ONCE, threshold=4, refractory=2
    )
    builder.connect(x, n, [[10]])
    graph = replace(builder.graph(), readout=Readout(("n",), (1.0,)))
    expected = oracle.play(graph, hw.chip("loihi-sim"), {"x": np.array([[1], [0], [0], [0], [0]])})
    assert expected.arrays["u"]["n"].ravel().tolist() == [
        0,
        charge,
        charge // 2,
        charge // 4,
        charge // 8,
    ]
    assert expected.arrays["potential"]["n"].ravel().tolist() == [
        0,
        charge,
        0,
        charge // 4,
        charge // 8,
    ]
    assert expected.arrays["v"]["n"].ravel().tolist() == [0, 0, 0, charge // 4, charge // 8]
    assert expected.arrays["spikes"]["n"].ravel().tolist() == [0, 1, 0, 0, 0]
    assert expected.scores == [1.0]
    assert expected.events == {}
