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
"""So many that every feature occurs in some seed, which a test below checks."""
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
    check_oracle(drawn.program, drawn.graph, {"x": drawn.spikes}, steps=None, engine=engine)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@EXAMPLES
@given(any_program.hybrid_programs())
def test_any_hybrid_equals_the_oracle(engine, drawn):
    check_oracle(drawn.program, drawn.graph, {"touch": drawn.spikes}, steps=None, engine=engine)


def features_of(case: any_phases.Case) -> dict[str, bool]:
    """Return, by the name of each feature that the builder allows, whether a program has it."""
    graph = case.graph
    groups = graph.groups
    parents = {group.name: group.joined_to for group in groups}
    children_by_parent = Counter(parent for parent in parents.values() if parent is not None)
    usual_voltage_max = case.program.chip.registers.voltage_max
    return {
        "joined": bool(children_by_parent),
        "chains": any(parents[parent] is not None for parent in children_by_parent),
        "fans": any(children > 1 for children in children_by_parent.values()),
        "several phases": len(graph.phases) > 1,
        # A phase with ``align_events`` begins only at the first touch of a recording.
        "late starts": any(phase.align_events is not None for phase in graph.phases),
        "several inputs": len(graph.inputs) > len(graph.phases),
        # An input with ``positions`` is read from the transpose buffer, channel by channel.
        "transposed": any(item.positions is not None for item in graph.inputs),
        "several delays": any(len(set(s.delay.tolist())) > 1 for s in graph.synapses),
        "negative exponents": any(s.exponent < 0 for s in graph.synapses),
        "refractory": any((group.refractory > 1).any() for group in groups),
        "biases": any(group.bias_mantissa.any() for group in groups),
        "narrow voltages": any((group.vmax < usual_voltage_max).any() for group in groups),
        "several cores": len(case.program.cores) > len(graph.phases),
        "potentials read": bool(graph.readout.from_step),
    }


def test_the_seeds_meet_everything_that_the_builder_allows():
    """Every kind of join, input, phase, delay, limit, wrap and clip occurs in some seed, so none goes untested."""
    met: Counter[str] = Counter(dict.fromkeys(oracle.EVENTS, 0))
    for seed in SEEDS:
        met.update({name: int(has) for name, has in features_of(any_phases.case(seed)).items()})
        for played in played_by_oracle(seed):
            # The wraps and clips of each population.
            for counts in played.events.values():
                met.update(counts)
    never_met = [name for name, count in met.items() if count == 0]
    assert never_met == []


def test_the_oracle_plays_a_step_by_hand():
    """One compartment, by hand: a charge, of which half is left after each step, a spike with its reset, a blocked step.

    It spikes above 4 units. The voltage forgets everything, so it is the current of the step, 10, 5, 2.5 and 1.25 units,
    or 0 where it is blocked.
    A ``potential`` is the voltage before it is compared with the threshold, and ``v`` after the reset.
    """
    charge = 10 * UNIT
    halves = FORGETS_AT_ONCE // 2
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 1)
    n = builder.add_compartments(
        "n", 1, decay_u=halves, decay_v=FORGETS_AT_ONCE, threshold=4, refractory=2
    )
    builder.connect(x, n, [[10]])
    graph = replace(builder.graph(), readout=Readout(("n",), (1.0,)))
    # The input spikes in step 0, and acts in step 1.
    recording = np.array([1, 0, 0, 0, 0])[:, np.newaxis]
    played = oracle.play(graph, hw.chip("loihi-sim"), {"x": recording})
    by_kind = {kind: arrays["n"].ravel().tolist() for kind, arrays in played.arrays.items()}
    assert by_kind == {
        "u": [0, charge, charge // 2, charge // 4, charge // 8],
        # A refractory count of 2 blocks the step after the spike: its voltage stays 0.
        "potential": [0, charge, 0, charge // 4, charge // 8],
        "v": [0, 0, 0, charge // 4, charge // 8],
        "spikes": [0, 1, 0, 0, 0],
    }
    assert played.scores == [1.0]
    assert played.events == {}, "no wraps or clips"
