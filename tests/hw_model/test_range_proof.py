"""Proven ranges of registers against simulations of the worst inputs, and against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.loihi_bounds import largest_answers
from hw_model.range_proof import PERIODS, prove_range
from tests.support.random_programs import random_program
from tests.support.register_units import (
    FORGETS_AT_ONCE,
    KEEPS_ALL,
    LARGEST_BIAS,
    LARGEST_THRESHOLD,
    LARGEST_WEIGHT,
    UNIT,
)

CHIP = hw.chip("loihi-sim")


def one_compartment(weights, exponent=0, chip=CHIP, sign_mode="mixed", **parameters):
    """Build a program of one compartment, driven by one line per weight; by default it keeps nothing and never spikes."""
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", len(weights))
    n = builder.add_compartments(
        "n",
        1,
        **{
            "threshold": LARGEST_THRESHOLD,
            "decay_u": FORGETS_AT_ONCE,
            "decay_v": FORGETS_AT_ONCE,
            **parameters,
        },
    )
    builder.connect(x, n, [weights], exponent=exponent, sign_mode=sign_mode)
    return builder.build()


def largest(program, spikes, name="n"):
    """Return the largest magnitude of u, and of v before a reset, that a recording reaches."""
    result = hw.simulate(program, spikes, probe=("u", "potential"))
    return int(np.abs(result.u[name]).max()), int(np.abs(result.potential[name]).max())


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize(
    ("decay_u", "decay_v", "steps"),
    [(4096, 4096, 5), (1024, 4096, 200), (390, 390, 2000), (4095, 17, 20_000), (100, 3000, 3000)],
)
def test_all_inputs_in_every_step_reach_the_bound(decay_u, decay_v, steps, sign):
    program = one_compartment([sign * 10, sign * 4], decay_u=decay_u, decay_v=decay_v)
    proven = prove_range(program)[0]
    u, v = largest(program, np.ones((steps, 2), dtype=np.uint8))
    bound = (proven.u, proven.v)
    assert (u, v) == tuple(int((b.high if sign > 0 else -b.low)[0]) for b in bound)


@pytest.mark.parametrize(
    ("weights", "low", "high"),
    [([10, 4], 0, 14), ([-10, -4], -14, 0), ([10, -4], -4, 10)],
    ids=["positive", "negative", "both"],
)
def test_a_charge_lies_between_the_sums_of_the_weights_of_each_sign(weights, low, high):
    """With decays that keep nothing, u and v have the same bounds as the charge."""
    proven = prove_range(one_compartment(weights))[0]
    for bounds in (proven.q, proven.u, proven.v):
        assert (bounds.low.tolist(), bounds.high.tolist()) == ([low * UNIT], [high * UNIT])


@pytest.mark.parametrize("bias", [1, -1, 64], ids=["the least", "the least, down", "more"])
def test_what_does_not_decay_has_no_bound(bias):
    proven = prove_range(one_compartment([0], decay_v=KEEPS_ALL, bias=bias))[0]
    assert (proven.v.low[0], proven.v.high[0]) == ((0, np.inf) if bias > 0 else (-np.inf, 0))
    assert not proven.cannot_clip[0]


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([0.3, 0.9, 1.0]))
def test_no_input_makes_a_safe_compartment_wrap_or_clip(seed, rate):
    program, *_ = random_program(seed)
    r = np.random.default_rng(seed)
    spikes = (r.random((3, 300, 4)) < rate).astype(np.uint8)
    spikes[1] = np.arange(300)[:, None] % 7 < 3
    result = hw.simulate(program, spikes, probe=("u", "potential"))
    for core, proven in zip(program.cores, prove_range(program), strict=True):
        for piece in core.slices:
            on_core = slice(piece.offset, piece.offset + piece.size)
            u = result.u[piece.group]
            v = result.potential[piece.group]
            cannot_wrap = proven.cannot_wrap[on_core]
            highest_u = proven.u.high[on_core][cannot_wrap]
            lowest_u = proven.u.low[on_core][cannot_wrap]
            assert (u.max(axis=(0, 1))[cannot_wrap] <= highest_u).all()
            assert (u.min(axis=(0, 1))[cannot_wrap] >= lowest_u).all()
            assert (v.max(axis=(0, 1)) <= proven.v.high[on_core]).all()
            assert (v.min(axis=(0, 1)) >= proven.v.low[on_core]).all()
            events = result.events.get(
                piece.group, {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 0}
            )
            if cannot_wrap.all():
                assert events["charge_wraps"] == events["current_wraps"] == 0
            if proven.cannot_clip[on_core].all():
                assert events["voltage_clips"] == 0


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    decay_u=st.sampled_from([1, 100, 390, 2000, 4096]),
    decay_v=st.sampled_from([1, 50, 390, 4096]),
    bias=st.sampled_from([0, 640, -12800]),
)
def test_a_rate_that_is_called_safe_is_safe(seed, decay_u, decay_v, bias):
    r = np.random.default_rng(seed)
    weights = (2 * r.integers(-100, 127, 5)).tolist()
    program = one_compartment(
        weights, decay_u=decay_u, decay_v=decay_v, bias=bias, vmax=2**19 - 1, vmin=1 - 2**19
    )
    period = int(prove_range(program)[0].safe_period[0])
    assert period in (0, *PERIODS)
    if period == 0:
        return
    steps = np.arange(12_000)[:, None]
    for sources in (np.array(weights) > 0, np.array(weights) < 0, np.ones(5, dtype=bool)):
        counts = hw.simulate(program, ((steps % period == 0) & sources).astype(np.uint8)).counts
        assert (counts.wraps, counts.clips) == (0, 0)


@pytest.mark.parametrize("period", [2, 3, 16])
@pytest.mark.parametrize(
    ("decay_u", "decay_v"),
    [(390, 390), (379, 401), (4096, 390), (390, 4096), (4096, 4096), (40, 41)],
)
def test_gains_are_sums_over_charges_without_end(decay_u, decay_v, period):
    """They equal a filter that runs step by step in real numbers, until nothing of the first charge is left."""
    u = v = most_u = most_v = 0.0
    for step in range(period * (8000 // period)):
        u = u * (4096 - decay_u) / 4096 + (step % period == 0)
        v = v * (4096 - decay_v) / 4096 + u
        most_u = max(most_u, u)
        most_v = max(most_v, v)
    assert largest_answers(decay_u, decay_v, period) == pytest.approx((most_u, most_v), rel=2e-9)


@pytest.mark.parametrize(
    "period",
    [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 512, 1024, 2048, 4096],
)
def test_a_safe_period_is_the_shortest_for_which_the_voltage_stays_below_its_limit(period):
    """A voltage that loses 1 / 4096 per step reaches Q / (1 - (4095 / 4096)^p) under a charge Q every p steps.

    The weights are the largest for which it stays below vmax, so that every shorter period lets it clip.
    """
    vmax = 2**21 - 1
    total_weight = int(vmax * (1 - (4095 / 4096) ** period) / UNIT)
    whole_weights, rest = divmod(total_weight, LARGEST_WEIGHT + 1)
    program = one_compartment(
        [LARGEST_WEIGHT + 1] * whole_weights + [rest],
        sign_mode="excitatory",
        decay_v=1,
        vmax=vmax,
    )
    assert prove_range(program)[0].safe_period.tolist() == [period]


def test_a_lower_rate_is_safe_where_spikes_in_every_step_are_not():
    program = one_compartment([254], decay_u=390, decay_v=390, vmax=2**19 - 1)
    proven = prove_range(program)[0]
    assert not proven.cannot_clip[0]
    period = int(proven.safe_period[0])
    assert period > 1
    shorter = PERIODS[PERIODS.index(period) - 1]
    spikes = (np.arange(4000)[:, None] % max(shorter // 2, 1) == 0).astype(np.uint8)
    assert hw.simulate(program, spikes).counts.clips > 0


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
def test_a_bias_takes_part_in_the_wrap(sign):
    """Here u never wraps, but u + bias does."""
    program = one_compartment([sign * 252], decay_u=1060, bias=sign * LARGEST_BIAS, exponent=7)
    proven = prove_range(program)[0]
    assert (np.abs([proven.u.low[0], proven.u.high[0]]) < 2**23).all()
    assert not proven.cannot_wrap[0]
    assert hw.simulate(program, np.ones((100, 1), dtype=np.uint8)).counts.current_wraps > 0
    assert prove_range(one_compartment([sign * 252], decay_u=1060, exponent=7))[0].cannot_wrap[0]


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
def test_a_bias_that_pulls_back_does_not_keep_the_current_from_wrapping(sign):
    """Here u wraps, and u + bias would not."""
    program = one_compartment([sign * 252], decay_u=1000, bias=-sign * LARGEST_BIAS, exponent=7)
    assert not prove_range(program)[0].cannot_wrap[0]
    assert hw.simulate(program, np.ones((100, 1), dtype=np.uint8)).counts.current_wraps > 0


def test_a_compartment_that_wraps_is_not_safe_because_it_cannot_clip():
    """If v is wider than u, no current can make v clip, but a current may still wrap."""
    narrow = replace(CHIP, registers=replace(CHIP.registers, current_bits=20))
    program = one_compartment([252], exponent=7, chip=narrow)
    proven = prove_range(program)[0]
    assert (proven.cannot_clip[0], proven.cannot_wrap[0], proven.safe_period[0]) == (True, False, 0)
    assert hw.simulate(program, [[1], [0]]).counts.current_wraps == 1


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize(
    ("exponent", "bias", "decay_u", "period"),
    [(6, LARGEST_BIAS, FORGETS_AT_ONCE, 0), (5, 0, 1024, 3)],
    ids=["with its bias", "more often than every third step"],
)
def test_a_rate_at_which_a_narrow_current_would_wrap_is_not_safe(
    exponent, bias, decay_u, period, sign
):
    """The voltage, three bits wider, stays far below its end."""
    narrow = replace(CHIP, registers=replace(CHIP.registers, current_bits=20))
    program = one_compartment(
        [sign * 250], exponent=exponent, chip=narrow, bias=sign * bias, decay_u=decay_u
    )
    assert prove_range(program)[0].safe_period[0] == period
    steps = np.arange(60)[:, None]
    assert (
        hw.simulate(
            program, (steps % max(period - 1, 1) == 0).astype(np.uint8)
        ).counts.current_wraps
        > 0
    )
    if period:
        assert (
            hw.simulate(program, (steps % period == 0).astype(np.uint8)).counts.current_wraps == 0
        )


def test_a_parent_is_unsafe_if_a_child_may_wrap():
    """Two children have negative weights only, but their charges wrap to positive ones, and their v is clipped to vmax."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    common = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "vmin": 0, "vmax": 2**15 - 1}
    soma = builder.add_compartments("soma", 1, threshold=LARGEST_THRESHOLD, **common)
    for name in ("a", "b"):
        child = builder.add_compartments(name, 1, threshold=0, joined_to=soma, **common)
        builder.connect(x, child, [[-254, -254]], exponent=7)
    program = builder.build()
    assert prove_range(program)[0].safe_period.tolist() == [0, 0, 0]
    counts = hw.simulate(program, [[1, 1], [0, 0]]).events["soma"]
    assert counts["voltage_clips"] == 1


def test_a_charge_that_wraps_is_passed_on():
    """No child's u or v leaves its register, but the charge of one wraps, to a value that makes their parent clip."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    forgets = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
    soma = builder.add_compartments("soma", 1, threshold=LARGEST_THRESHOLD, **forgets)
    for k, weights in enumerate([[-254, -4], *4 * [[254, 0]]]):
        child = builder.add_compartments(f"child{k}", 1, threshold=0, joined_to=soma, **forgets)
        builder.connect(x, child, [weights], exponent=7)
    program = builder.build()
    proven = prove_range(program)[0]
    assert proven.cannot_wrap.tolist() == [False, True, True, True, True, True]
    assert proven.safe_period.tolist() == [0, 1, 1, 1, 1, 0]
    assert hw.simulate(program, [[1, 1], [0, 0]]).events["soma"]["voltage_clips"] == 1


def test_a_register_without_decay_is_never_safe():
    proven = prove_range(one_compartment([2], decay_u=KEEPS_ALL, decay_v=KEEPS_ALL))[0]
    assert (proven.u.high[0], proven.safe_period[0]) == (np.inf, 0)
    assert not proven.cannot_wrap[0]
    assert not proven.cannot_clip[0]
    assert prove_range(one_compartment([2], decay_v=KEEPS_ALL, bias=1))[0].v.high[0] == np.inf
    assert prove_range(one_compartment([-2], decay_v=KEEPS_ALL, bias=1))[0].v.low[0] == -np.inf


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
def test_children_pass_on_what_their_limits_leave(sign):
    """One child beyond vmax passes on vmax; three that stay below it exceed what their parent can hold."""
    limits = {
        "vmin": 1 - 2**15,
        "vmax": 2**15 - 1,
        "decay_u": FORGETS_AT_ONCE,
        "decay_v": FORGETS_AT_ONCE,
    }
    ends = []
    for children, exponent in ((1, 2), (3, 0)):
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 1)
        soma = builder.add_compartments("soma", 1, threshold=LARGEST_THRESHOLD, **limits)
        for k in range(children):
            child = builder.add_compartments(f"child{k}", 1, threshold=0, joined_to=soma, **limits)
            builder.connect(x, child, [[sign * 254]], exponent=exponent)
        program = builder.build()
        proven = prove_range(program)[0]
        end = (proven.v.high if sign > 0 else -proven.v.low)[-1]
        clips = hw.simulate(program, [[1], [0]]).events["soma" if children == 3 else "child0"][
            "voltage_clips"
        ]
        ends.append((end, proven.safe_period[-1], clips))
    assert ends == [(2**15 - 1, 1, 1), (3 * LARGEST_WEIGHT * UNIT, 0, 1)]


def test_joined_voltages_are_in_the_bound():
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    soma = builder.add_compartments(
        "soma", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=LARGEST_THRESHOLD
    )
    for name in ("a", "b"):
        child = builder.add_compartments(
            name, 1, decay_u=FORGETS_AT_ONCE, decay_v=2048, threshold=0, joined_to=soma
        )
        builder.connect(x, child, [[100]])
    program = builder.build()
    proven = prove_range(program)[0]
    # Each step keeps half of v, rounded down, and adds a charge of 100 * 64: v settles one below twice the charge.
    v_of_child = 2 * 100 * UNIT - 1
    assert proven.v.high.tolist() == [v_of_child, v_of_child, 2 * v_of_child]
    assert largest(program, np.ones((50, 1), dtype=np.uint8), "soma")[1] == 2 * v_of_child


def test_truncation_removes_less_from_a_sum_than_from_its_terms():
    """Truncation removes less from a sum than from its terms, so bounds of the terms cannot be added.

    A charge of 64 every 6 steps alone stays below 494, and 1 in every step alone stays at 1, but together they exceed 511.
    """
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    ends = {"vmin": -511, "vmax": 511}
    n = builder.add_compartments(
        "n", 1, decay_u=FORGETS_AT_ONCE, decay_v=94, threshold=LARGEST_THRESHOLD, **ends
    )
    builder.add_compartments(
        "one",
        1,
        decay_u=FORGETS_AT_ONCE,
        decay_v=FORGETS_AT_ONCE,
        threshold=0,
        bias=1,
        joined_to=n,
        **ends,
    )
    builder.connect(x, n, [[1]], sign_mode="excitatory")
    program = builder.build()
    period = int(prove_range(program)[0].safe_period[1])
    steps = np.arange(3000)[:, None]
    assert hw.simulate(program, (steps % 6 == 0).astype(np.uint8)).counts.clips > 0
    assert period == 8
    assert hw.simulate(program, (steps % period == 0).astype(np.uint8)).counts.clips == 0
