"""Both engines give equal integers: against each other, against an independent oracle, and against numbers by hand.

The oracle, :mod:`tests.support.loihi_oracle`, is a second implementation in plain Python that shares no code.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.accounting.activity import count_totals
from hw_model.description.counts import COUNTED
from hw_model.engine.playing import Player, list_events, play
from hw_model.engine.trace import PhaseTrace
from hw_model.simulation import ENGINES
from tests.support import loihi_oracle as oracle
from tests.support.against_oracle import check_oracle
from tests.support.random_programs import SMALL, random_program
from tests.support.register_units import (
    FORGETS_AT_ONCE,
    KEEPS_ALL,
    LARGEST_BIAS,
    LARGEST_WEIGHT,
    UNIT,
)

CHIP = hw.chip("loihi-sim")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("chip", [CHIP, SMALL], ids=["one core", "many cores"])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_engine_equals_the_oracle(engine, chip, seed):
    program, graph, _, spikes = random_program(seed, chip)
    check_oracle(program, graph, {"x": spikes[None]}, steps=None, engine=engine)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_engines_agree_on_every_probe_and_count(seed):
    program, _, _, spikes = random_program(seed, SMALL)
    probe = ("spikes", "u", "v", "potential", "activity")
    fast, slow = (hw.simulate(program, spikes, engine=engine, probe=probe) for engine in ENGINES)
    for name in program.populations:
        for kind in ("u", "v", "potential"):
            assert np.array_equal(getattr(fast, kind)[name], getattr(slow, kind)[name]), (
                kind,
                name,
            )
    assert replace(fast.counts, skipped_steps=0) == slow.counts
    assert fast.events == slow.events
    for phase in ("time",):
        for a, b in zip(fast.activity[phase], slow.activity[phase], strict=True):
            assert all(np.array_equal(a.by_core[name], b.by_core[name]) for name in a.by_core)


def test_engines_agree_on_a_chip_of_other_registers():
    """Long delays, long refractory periods, wide biases and a narrow voltage, at the limits of a chip file."""
    registers = replace(
        CHIP.registers,
        voltage_bits=15,
        delay_max=1022,
        refractory_max=300,
        bias_mantissa_bits=20,
        bias_exponent_max=2,
    )
    builder = hw.ProgramBuilder(replace(CHIP, registers=registers))
    line = builder.add_input("line", 3)
    cell = builder.add_compartments(
        "cell",
        4,
        decay_u=900,
        decay_v=[0, 100, 4095, 4096],
        threshold=100,
        bias=[0, 5, -9, 1 << 20],
        refractory=300,
    )
    longest_delay = registers.delay_max
    builder.connect(line, cell, np.full((4, 3), 200), delay=[[0, 1, longest_delay]] * 4)
    builder.connect(cell, cell, np.full((4, 4), -50), delay=700)
    program = builder.build()
    last_event_row = 1000
    spikes = np.zeros((2500, 3), dtype=np.uint8)
    spikes[[0, 3, 5, last_event_row]] = 1
    fast, slow = (
        hw.simulate(program, spikes, engine=engine, probe=("spikes", "u", "v"))
        for engine in ENGINES
    )
    assert np.array_equal(fast.u["cell"], slow.u["cell"])
    assert np.array_equal(fast.v["cell"], slow.v["cell"])
    assert replace(fast.counts, skipped_steps=0) == slow.counts
    assert slow.counts.voltage_clips > 0
    assert slow.u["cell"][last_event_row + 1 + longest_delay].any()
    steps_between_spikes = np.diff(np.flatnonzero(slow.spikes["cell"][:, 3]))
    assert steps_between_spikes.min() == registers.refractory_max


def joined_children(builder: hw.ProgramBuilder, parents: int = 1, chain: bool = False) -> None:
    """Add compartment ``soma`` and 300 children at the end of their range, joined to it or, as a chain, each to the next.

    300 times a voltage of 23 bits does not fit 31 bits; 255 times it does.
    """
    node = builder.add_compartments(
        "soma", parents, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100
    )
    soma = node
    for i in range(300):
        child = builder.add_compartments(
            f"child{i}",
            parents,
            decay_u=FORGETS_AT_ONCE,
            decay_v=KEEPS_ALL,
            bias=LARGEST_BIAS,
            threshold=0,
            joined_to=node,
        )
        node = child if chain else soma


@pytest.mark.parametrize("chain", [False, True], ids=["fan", "chain"])
def test_the_sum_of_many_joined_voltages_does_not_wrap(chain):
    """The sum exceeds 32 bits after some steps. An engine that wrapped it would lose spikes."""
    builder = hw.ProgramBuilder(CHIP)
    builder.add_input("x", 1)
    joined_children(builder, chain=chain)
    program = builder.build()
    silence = np.zeros((30, 1), dtype=np.uint8)
    fast, slow = (
        hw.simulate(program, silence, engine=engine, probe=("spikes", "potential"))
        for engine in ENGINES
    )
    assert slow.counts.spikes == 30
    assert np.array_equal(fast.spikes["soma"], slow.spikes["soma"])
    assert np.array_equal(fast.potential["soma"], slow.potential["soma"])
    assert fast.counts == slow.counts


@pytest.mark.parametrize("row", [60, 63], ids=["", "to its last row"])
@pytest.mark.parametrize("decay", [FORGETS_AT_ONCE, 256], ids=["at rest between", "decaying"])
def test_a_tile_of_silence_waits_for_what_is_under_way(decay, row):
    """Events of one tile of 64 steps are due in the next, which has no events; the third is silent, the fourth has one."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    y = builder.add_compartments("y", 2, decay_u=decay, decay_v=decay, threshold=30)
    delay = 62
    builder.connect(x, y, [[60, 0], [0, 60]], delay=[[0, 0], [0, delay]])
    builder.read_out(y)
    program = builder.build()
    recording = np.zeros((260, 2), dtype=np.uint8)
    recording[[row, 200], 1] = 1
    recording[[3, 129], 0] = 1
    fast, slow = (
        hw.simulate(program, recording, engine=engine, probe=("spikes", "u", "v"))
        for engine in ENGINES
    )
    for kind in ("spikes", "u", "v"):
        assert np.array_equal(getattr(fast, kind)["y"], getattr(slow, kind)["y"])
    assert fast.spikes["y"][:, 1].nonzero()[0][0] == row + 1 + delay
    session = hw.Session(program)
    parts = [session.push(part).spikes["y"] for part in np.split(recording, [64, 128, 200])]
    assert np.array_equal(np.concatenate(parts), slow.spikes["y"].cumsum(axis=0, dtype=np.int64))
    # Of 260 steps, what decays slowly keeps most busy.
    assert (fast.counts.skipped_steps > 200) == (decay == FORGETS_AT_ONCE)


@pytest.mark.minutes
def test_a_chain_of_children_as_long_as_a_core_adds_up():
    """Each compartment adds its v to the next. Recursive code would exceed Python's limit on such a chain."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    last = node = builder.add_compartments(
        "soma", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=1021
    )
    children = CHIP.limits.compartments_per_core - 1
    for i in range(children):
        node = builder.add_compartments(
            f"child{i}",
            1,
            decay_u=FORGETS_AT_ONCE,
            decay_v=FORGETS_AT_ONCE,
            bias=UNIT,
            threshold=0,
            joined_to=node,
        )
    builder.connect(x, last, [[2]])
    builder.read_out(last)
    program = builder.build()
    result = hw.simulate(program, np.zeros((3, 1), dtype=np.uint8), probe=("potential",))
    assert result.potential["soma"].ravel().tolist() == [children * UNIT] * 3
    assert hw.stop_when_proven(program, np.zeros((1, 3, 1), dtype=np.uint8)).steps.tolist() == [0]


def test_a_bias_wider_than_32_bits_wraps_in_each_step():
    """It wraps in each step, and keeps the compartment busy even if its low 32 bits are zero."""
    builder = hw.ProgramBuilder(
        replace(
            CHIP, registers=replace(CHIP.registers, bias_mantissa_bits=24, bias_exponent_max=24)
        )
    )
    builder.add_input("x", 1)
    builder.add_compartments(
        "n",
        4,
        decay_u=FORGETS_AT_ONCE,
        decay_v=KEEPS_ALL,
        threshold=100,
        bias=[1 << 47, 1 << 32, -(1 << 48), 0],
    )
    program = builder.build()
    silence = np.zeros((800, 1), dtype=np.uint8)
    fast, slow = (hw.simulate(program, silence, engine=engine) for engine in ENGINES)
    biased = 3 * len(silence)
    assert (slow.counts.neuron_updates_active, slow.counts.current_wraps) == (biased, biased)
    assert fast.counts == slow.counts


@pytest.mark.parametrize(
    ("registers", "bound"),
    [
        ({"voltage_bits": 16}, 2**16 - 1),
        ({"charge_bits": 19, "current_bits": 20, "voltage_bits": 16}, 2**16 - 1),
        ({"charge_bits": 9, "current_bits": 40, "voltage_bits": 40}, 2**40 - 1),
        ({"charge_bits": 40, "current_bits": 9, "voltage_bits": 10}, 2**10 - 1),
    ],
    ids=["voltage alone", "all", "wide behind narrow", "narrow behind wide"],
)
def test_registers_of_other_widths_wrap_and_clip_at_their_ends(registers, bound):
    """Registers of other widths wrap and clip at their ends, by the formulas of the chip's description in Python."""
    chip = replace(CHIP, registers=replace(CHIP.registers, **registers))
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 1)
    n = builder.add_compartments(
        "n",
        1,
        decay_u=KEEPS_ALL,
        decay_v=KEEPS_ALL,
        threshold=chip.registers.threshold_mantissa_max,
    )
    exponent = 3
    charge = (LARGEST_WEIGHT << exponent) * UNIT
    builder.connect(x, n, [[LARGEST_WEIGHT]], exponent=exponent)
    spikes = np.ones((60, 1), dtype=np.uint8)
    u = v = clips = wraps = 0
    expected = []
    for t in range(60):
        total = charge if t else 0
        q = oracle.wrap(total, chip.registers.charge_bits)
        wrapped = oracle.wrap(u + q, chip.registers.current_bits)
        wraps += (q != total) + (wrapped != u + q)
        u = wrapped
        v = v + wrapped
        clips += abs(v) > bound
        v = max(-bound, min(bound, v))
        expected.append((u, v))
    for engine in ENGINES:
        result = hw.simulate(builder.build(), spikes, engine=engine, probe=("u", "v"))
        registers_of_steps = np.hstack((result.u["n"], result.v["n"])).tolist()
        assert [tuple(of_step) for of_step in registers_of_steps] == expected
        assert (result.counts.wraps, result.counts.clips) == (wraps, clips)


def test_a_voltage_wider_than_a_factor_is_multiplied_exactly():
    """Products in 32-bit lanes have factors of 15 bits and a sign, for voltages of up to 27 bits: 28 need 64-bit lanes.

    v falls by one charge more in every step.
    """
    builder = hw.ProgramBuilder(replace(CHIP, registers=replace(CHIP.registers, voltage_bits=28)))
    x = builder.add_input("x", 1)
    n = builder.add_compartments("n", 1, decay_u=KEEPS_ALL, decay_v=KEEPS_ALL, threshold=100)
    exponent = 3
    charge = (-LARGEST_WEIGHT << exponent) * UNIT
    builder.connect(x, n, [[-LARGEST_WEIGHT]], exponent=exponent)
    for engine in ENGINES:
        result = hw.simulate(
            builder.build(), np.ones((60, 1), dtype=np.uint8), engine=engine, probe=("v",)
        )
        # u is t charges after step t, and v adds them up.
        expected = [charge * (t * (t + 1) // 2) for t in range(60)]
        assert result.v["n"][:, 0].tolist() == expected, engine


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_skipping_changes_nothing(seed):
    program, _, _, spikes = random_program(seed, SMALL)
    spikes[:15] = 0
    probe = ("spikes", "u", "v", "potential", "activity")
    on, off = (hw.simulate(program, spikes, probe=probe, skip=skip) for skip in (True, False))
    for name in program.populations:
        for kind in ("u", "v", "potential"):
            assert np.array_equal(getattr(on, kind)[name], getattr(off, kind)[name]), (kind, name)
    assert off.counts.skipped_steps == 0
    assert replace(on.counts, skipped_steps=0) == off.counts
    assert on.events == off.events


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_results_do_not_depend_on_placement(seed):
    on_usual_cores, _, _, spikes = random_program(seed, CHIP)
    on_small_cores, *_ = random_program(seed, SMALL)
    usual_cores = len(on_usual_cores.cores)
    assert len(on_small_cores.cores) > usual_cores or usual_cores > 1
    result = hw.simulate(on_usual_cores, spikes)
    small_result = hw.simulate(on_small_cores, spikes)
    for name, array in result.spikes.items():
        assert np.array_equal(array, small_result.spikes[name])
    for count in (
        "synaptic_ops",
        "neuron_updates",
        "neuron_updates_active",
        "spikes",
        "synaptic_ops_after_end",
    ):
        assert result.counts[count] == small_result.counts[count], count


def test_synaptic_ops_are_spikes_times_fan_out():
    program, _, links, spikes = random_program(5)
    result = hw.simulate(program, spikes)
    sent = {"x": spikes, **result.spikes}
    ops = sum(
        int((sent[k["source"]].sum(axis=0) * (k["weights"] != 0).sum(axis=0)).sum()) for k in links
    )
    steps = len(spikes)
    late = 0
    for k in links:
        rows, targets, sources = np.nonzero(np.repeat((k["weights"] != 0)[None], steps, axis=0))
        arrives = rows + 1 + k["delay"][targets, sources]
        late += int((sent[k["source"]][rows, sources].astype(bool) & (arrives >= steps)).sum())
    assert result.counts.synaptic_ops == ops
    assert result.counts.synaptic_ops_after_end == late


@pytest.mark.parametrize(
    "sent", [(1 << 30) + 1, (1 << 52) + 1, (1 << 58) + 1], ids=["few", "more than floats", "most"]
)
def test_no_number_of_spikes_is_counted_inexactly(sent):
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    y = builder.add_compartments("y", 7, threshold=1)
    builder.connect(x, y, 2 * np.ones((7, 1), dtype=np.int64))
    program = builder.build()
    (phase,) = program.phases
    lists = {"x": list_events("x", np.zeros((2, 1, 1), dtype=np.uint8))}
    played = play(program, phase, lists, steps=None, player=Player())._replace(steps=sent)
    trace = PhaseTrace.empty(played._replace(steps=1), n=7, pieces=1, windows={})
    trace.sent[1] = [sent, 1, 2, 3, 4, 5, 6, 7]
    assert count_totals(program, phase.name, played, trace)[
        :, COUNTED.index("synaptic_ops")
    ].tolist() == [0, 7 * sent]


def test_a_batch_equals_its_recordings_one_by_one():
    program, _, _, spikes = random_program(3)
    batch = np.stack([spikes, np.roll(spikes, 3, axis=0), np.zeros_like(spikes)])
    together = hw.simulate(program, batch, probe=("spikes", "v"))
    for i, recording in enumerate(batch):
        alone = hw.simulate(program, recording, probe=("spikes", "v"))
        assert np.array_equal(together.spikes["h"][i], alone.spikes["h"])
        assert np.array_equal(together.v["h/dendrite"][i], alone.v["h/dendrite"])
        assert together.per_recording[i] == alone.counts


def test_silence_is_skipped_and_counted():
    """No step runs before the first event, and none after its last trace has faded."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    soma = builder.add_compartments(
        "soma", 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=90, refractory=5
    )
    dendrite = builder.add_compartments(
        "soma/dendrite", 2, decay_u=2048, decay_v=2048, threshold=0, joined_to=soma
    )
    builder.connect(x, dendrite, [[100], [-40]])
    program = builder.build()
    steps = 400
    event_row = 150
    spikes = np.zeros((steps, 1), dtype=np.uint8)
    spikes[event_row] = 1
    fast, slow = (
        hw.simulate(program, spikes, engine=engine, probe=("spikes", "v")) for engine in ENGINES
    )
    assert np.array_equal(fast.v["soma/dendrite"], slow.v["soma/dendrite"])
    assert np.array_equal(fast.spikes["soma"], slow.spikes["soma"])
    assert fast.spikes["soma"].sum() > 0
    moving = np.flatnonzero(np.abs(slow.v["soma/dendrite"]).sum(axis=1))
    first_moving = event_row + 1
    assert (moving[0], slow.counts.skipped_steps) == (first_moving, 0)
    silent = first_moving + (steps - 1 - moving[-1])
    # The soma may be refractory, and the current under way, for some steps more.
    assert silent - 8 <= fast.counts.skipped_steps <= silent


def test_a_refractory_sum_counts_on_while_its_dendrites_rest():
    """A soma that only adds its dendrites is at rest when it may spike again, not already when its dendrites rest."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    soma = builder.add_compartments(
        "soma", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=90, refractory=5
    )
    dendrite = builder.add_compartments(
        "dendrite", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=0, joined_to=soma
    )
    builder.connect(x, dendrite, [[100]])
    spikes = np.zeros((40, 1), dtype=np.uint8)
    spikes[[0, 3, 10, 15, 19, 25]] = 1
    for engine in ENGINES:
        result = hw.simulate(builder.build(), spikes, engine=engine).spikes["soma"]
        assert np.flatnonzero(result).tolist() == [1, 11, 16, 26], engine


def test_a_charge_beyond_32_bits_is_counted_as_a_wrap():
    """The charge is 2^32 - 2048 in units of 64. In 32 bits it would be -2048, which does not wrap.

    8 * 16513 * (254 << 7) = 2^32 - 2048.
    """
    sources = 16513
    limits = replace(CHIP.limits, input_axons_per_core=20_000, synapse_words_per_core=10**9)
    builder = hw.ProgramBuilder(replace(CHIP, limits=limits))
    x = builder.add_input("x", sources)
    y = builder.add_compartments(
        "y", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    for _ in range(8):
        builder.connect(x, y, np.full((1, sources), 254), exponent=7)
    program = builder.build()
    spikes = np.zeros((3, sources), dtype=np.uint8)
    spikes[0] = 1
    fast, slow = (hw.simulate(program, spikes, engine=engine, probe=("u",)) for engine in ENGINES)
    assert slow.u["y"].ravel().tolist() == fast.u["y"].ravel().tolist() == [0, -2048 * 64, 0]
    assert slow.counts.charge_wraps == fast.counts.charge_wraps == 1


def test_a_bias_is_never_skipped():
    builder = hw.ProgramBuilder(CHIP)
    builder.add_input("x", 1)
    builder.add_compartments(
        "n", 1, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=100, bias=640
    )
    program = builder.build()
    result = hw.simulate(program, np.zeros((100, 1), dtype=np.uint8))
    assert (result.counts.skipped_steps, result.counts.spikes) == (0, 9)


@pytest.mark.parametrize("engine", ["fast", "reference"])
def test_a_group_without_a_name_is_played_like_another(engine):
    def spikes(name):
        b = hw.ProgramBuilder(hw.chip("loihi-sim"))
        b.connect(b.add_input("x", 1), b.add_compartments(name, 1, threshold=1), [[20]])
        return hw.simulate(b.build(), [[1], [0], [1]], engine=engine).spikes[name]

    assert np.array_equal(spikes(""), spikes("h"))
    assert spikes("").any()
