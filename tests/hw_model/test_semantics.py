"""The step of a compartment on both engines, against numbers worked out by hand for tiny programs."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.simulation import ENGINES
from tests.support.register_units import (
    CHARGE_RANGE,
    CURRENT_RANGE,
    FORGETS_AT_ONCE,
    KEEPS_ALL,
    LARGEST_BIAS,
    LARGEST_THRESHOLD,
    LARGEST_WEIGHT,
    UNIT,
    VOLTAGE_MAX,
)

CHIP = hw.chip("loihi-sim")
CHARGE = 100 * UNIT
"""What an event adds to the current of :func:`one_compartment`, in counts of the register."""
LARGEST_CHARGE = (LARGEST_WEIGHT << 7) * UNIT
"""The largest charge of one synapse. It fits the register of a charge, and twice as much does not."""


def one_compartment(weight=CHARGE // UNIT, delay=0, exponent=0, sign_mode="mixed", **parameters):
    """Build a compartment ``n`` with one input; by default it never spikes, and keeps its voltage but no current."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    defaults = {"decay_u": FORGETS_AT_ONCE, "decay_v": KEEPS_ALL, "threshold": LARGEST_THRESHOLD}
    n = builder.add_compartments("n", 1, **{**defaults, **parameters})
    builder.connect(x, n, [[weight]], delay=delay, exponent=exponent, sign_mode=sign_mode)
    return builder.build()


def played(program, events, steps, engine):
    """Simulate a recording of ``steps`` rows with an event in each of the rows ``events``."""
    rows = np.zeros((steps, 1), dtype=np.uint8)
    rows[events] = 1
    return hw.simulate(program, rows, engine=engine, probe=("spikes", "u", "v", "potential"))


@pytest.mark.parametrize("engine", ENGINES)
class TestStep:
    """The rules of a step, on each engine."""

    def test_an_input_of_row_t_acts_at_step_t_plus_1_plus_delay(self, engine):
        result = played(one_compartment(delay=3), [2], 9, engine)
        assert result.v["n"].ravel().tolist() == [0] * 6 + [CHARGE] * 3

    def test_current_keeps_and_voltage_adds_it(self, engine):
        result = played(
            one_compartment(decay_u=FORGETS_AT_ONCE // 2, decay_v=FORGETS_AT_ONCE // 4),
            [0],
            4,
            engine,
        )
        assert result.u["n"].ravel().tolist() == [0, CHARGE, CHARGE // 2, CHARGE // 4]
        v_2 = 3 * CHARGE // 4 + CHARGE // 2
        v_3 = 3 * v_2 // 4 + CHARGE // 4
        assert result.v["n"].ravel().tolist() == [0, CHARGE, v_2, v_3]

    def test_negative_values_decay_toward_zero(self, engine):
        result = played(
            one_compartment(weight=-2, decay_u=1, decay_v=FORGETS_AT_ONCE), [0], 3, engine
        )
        # -128 * 4095 / 4096 is a little above -128, and truncated toward zero.
        assert result.u["n"].ravel().tolist() == [0, -2 * UNIT, -2 * UNIT + 1]

    @pytest.mark.parametrize(
        ("threshold", "spikes"), [(100, 0), (99, 1)], ids=["equal does not spike", "above does"]
    )
    def test_threshold_is_strict(self, engine, threshold, spikes):
        assert (
            played(
                one_compartment(threshold=threshold, decay_v=FORGETS_AT_ONCE), [0], 3, engine
            ).counts.spikes
            == spikes
        )

    def test_a_spike_resets_v_but_not_u(self, engine):
        result = played(one_compartment(threshold=99, decay_u=KEEPS_ALL), [0], 4, engine)
        assert result.u["n"].ravel().tolist() == [0, CHARGE, CHARGE, CHARGE]
        assert result.v["n"].ravel().tolist() == [0, 0, 0, 0]
        assert result.potential["n"].ravel().tolist() == [0, CHARGE, CHARGE, CHARGE]
        assert result.spikes["n"].ravel().tolist() == [0, 1, 1, 1]

    def test_refractory_k_blocks_k_minus_1_steps_with_v_at_0(self, engine):
        result = played(
            one_compartment(threshold=1, decay_u=KEEPS_ALL, refractory=3), [0], 8, engine
        )
        assert result.spikes["n"].ravel().tolist() == [0, 1, 0, 0, 1, 0, 0, 1]
        assert result.v["n"].ravel().tolist() == [0] * 8
        assert result.potential["n"].ravel().tolist() == [0, CHARGE, 0, 0, CHARGE, 0, 0, CHARGE]

    def test_bias_acts_from_step_0(self, engine):
        lowest_bias = -4096 * 128
        result = played(one_compartment(bias=lowest_bias), [], 2, engine)
        assert result.v["n"].ravel().tolist() == [lowest_bias, 2 * lowest_bias]
        assert result.u["n"].ravel().tolist() == [0, 0]

    @pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
    def test_charge_wraps_at_21_bits(self, sign, engine):
        """One input is connected twice, so that its charges add up beyond the register."""
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 1)
        n = builder.add_compartments(
            "n", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=LARGEST_THRESHOLD
        )
        builder.connect(x, n, [[sign * LARGEST_WEIGHT]], exponent=7)
        builder.connect(x, n, [[sign * LARGEST_WEIGHT]], exponent=7)
        result = played(builder.build(), [0], 3, engine)
        assert result.u["n"].ravel().tolist() == [0, sign * (2 * LARGEST_CHARGE - CHARGE_RANGE), 0]
        assert (result.counts.charge_wraps, result.counts.current_wraps, result.counts.clips) == (
            1,
            0,
            0,
        )
        assert result.events == {"n": {"charge_wraps": 1, "current_wraps": 0, "voltage_clips": 0}}

    def test_current_wraps_at_23_bits(self, engine):
        result = played(
            one_compartment(
                weight=LARGEST_WEIGHT, exponent=7, decay_u=KEEPS_ALL, decay_v=FORGETS_AT_ONCE
            ),
            [0, 1, 2, 3, 4],
            7,
            engine,
        )
        assert result.u["n"].ravel().tolist() == [
            0,
            *(LARGEST_CHARGE * k for k in (1, 2, 3, 4)),
            5 * LARGEST_CHARGE - CURRENT_RANGE,
            5 * LARGEST_CHARGE - CURRENT_RANGE,
        ]
        assert result.counts.current_wraps == 1

    def test_current_and_bias_wrap_together(self, engine):
        program = one_compartment(
            weight=252, exponent=7, decay_u=KEEPS_ALL, decay_v=FORGETS_AT_ONCE, bias=LARGEST_BIAS
        )
        result = played(program, [0, 1, 2, 3], 6, engine)
        charge = (252 << 7) * UNIT  # four of them fit the current, and with the bias they do not
        drives = [charge * k + LARGEST_BIAS for k in (0, 1, 2, 3)]
        wrapped = charge * 4 + LARGEST_BIAS - CURRENT_RANGE
        assert result.v["n"].ravel().tolist() == [*drives, wrapped, wrapped]
        assert result.counts.current_wraps == 2

    def test_a_charge_acts_once(self, engine):
        """The slot that held it is empty a tile of steps later, and in the next recording."""
        rows = np.zeros((2, 200, 1), dtype=np.uint8)
        rows[0, 0] = 1
        result = hw.simulate(one_compartment(delay=3), rows, engine=engine, probe=("u",))
        assert np.argwhere(result.u["n"][:, :, 0]).tolist() == [[0, 4]]

    @pytest.mark.parametrize(
        ("parameters", "active"),
        [
            ({"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}, 2),
            ({"decay_u": FORGETS_AT_ONCE, "decay_v": KEEPS_ALL}, 4),
            ({"decay_u": KEEPS_ALL, "decay_v": FORGETS_AT_ONCE, "threshold": 99}, 4),
            ({"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "bias": 1}, 5),
        ],
        ids=["a charge, and what it left", "a voltage", "a current alone", "a bias"],
    )
    def test_a_compartment_is_active_while_it_holds_anything(self, engine, parameters, active):
        """An event of row 0 in five steps. A compartment is active while it has a charge, current, voltage or bias."""
        result = played(one_compartment(**parameters), [0], 5, engine)
        assert result.counts.neuron_updates_active == active

    @pytest.mark.parametrize("reached", [0, 20], ids=["by children alone", "by a synapse, too"])
    def test_a_compartment_is_active_when_a_child_passes_a_voltage(self, engine, reached):
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 2)
        forgets = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
        soma = builder.add_compartments("soma", 1, threshold=10, **forgets)
        child = builder.add_compartments("child", 1, threshold=0, joined_to=soma, **forgets)
        builder.connect(x, child, [[100, 0]])
        builder.connect(x, soma, [[0, reached]])
        # The child works on its charge and, a step later, on its current and voltage; the soma on what is joined.
        counts = hw.simulate(builder.build(), [[1, 0], *4 * [[0, 0]]], engine=engine).counts
        assert counts.neuron_updates_active == 3

    def test_compartments_of_one_chunk_do_not_influence_each_other(self, engine):
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 20)
        n = builder.add_compartments(
            "n", 20, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=[10, 200] * 10
        )
        builder.connect(x, n, 100 * np.eye(20))
        rows = np.concatenate((np.tri(20, dtype=np.uint8), np.zeros((2, 20), dtype=np.uint8)))
        result = hw.simulate(builder.build(), rows, engine=engine)
        assert np.array_equal(result.spikes["n"][1:, ::2], rows[:-1, ::2])
        assert not result.spikes["n"][:, 1::2].any()
        assert result.counts.neuron_updates_active == 20 * 21 // 2 + 20

    def test_wraps_and_clips_in_a_refractory_step_are_not_counted(self, engine):
        """The bias makes it spike at once, and for 62 steps its voltage is not compared with the threshold."""
        wide = {
            "weight": 252,
            "exponent": 7,
            "decay_u": KEEPS_ALL,
            "decay_v": FORGETS_AT_ONCE,
            "bias": LARGEST_BIAS,
            "vmax": 2**19 - 1,
        }
        result = played(
            one_compartment(**wide, threshold=100, refractory=63), [0, 1, 2, 3], 9, engine
        )
        assert (result.counts.spikes, result.counts.wraps, result.counts.clips) == (1, 0, 0)
        assert result.potential["n"].ravel().tolist() == [LARGEST_BIAS, *8 * [0]]

    def test_clips_of_a_refractory_soma_of_two_dendrites_are_not_counted(self, engine):
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 1)
        common = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "vmax": 2**13 - 1}
        soma = builder.add_compartments("soma", 1, threshold=100, refractory=5, **common)
        for name in ("one", "two"):
            builder.connect(
                x, builder.add_compartments(name, 1, threshold=0, joined_to=soma, **common), [[100]]
            )
        result = played(builder.build(), [0, 1], 4, engine)
        assert (result.counts.spikes, result.counts.clips) == (1, 1)
        assert result.potential["soma"].ravel().tolist() == [0, 2**13 - 1, 0, 0]

    def test_voltage_clips_to_the_register(self, engine):
        result = played(
            one_compartment(weight=LARGEST_WEIGHT, exponent=7, decay_u=FORGETS_AT_ONCE),
            [0, 1, 2, 3, 4],
            7,
            engine,
        )
        assert result.potential["n"].ravel().tolist() == [
            0,
            *(LARGEST_CHARGE * k for k in (1, 2, 3, 4)),
            VOLTAGE_MAX,
            0,
        ]
        assert result.spikes["n"].ravel().tolist() == [0, 0, 0, 0, 0, 1, 0]
        assert result.counts.clips == 1

    @pytest.mark.parametrize(
        ("limits", "lowest"),
        [({"vmin": 0}, 0), ({"vmin": 1 - 2**13}, 1 - 2**13), ({"vmin": 1 - 2**31}, -2 * CHARGE)],
        ids=["vmin 0", "vmin 1 - 2^13", "vmin beyond the register"],
    )
    def test_vmin_clips(self, engine, limits, lowest):
        result = played(one_compartment(weight=-2 * CHARGE // UNIT, **limits), [0], 3, engine)
        assert result.v["n"].ravel().tolist() == [0, lowest, lowest]

    def test_vmax_clips_before_the_threshold(self, engine):
        result = played(one_compartment(weight=200, vmax=2**11 - 1, threshold=40), [0], 3, engine)
        # 200 * 64 is above the threshold of 40 * 64; vmax, 2047, is below it.
        assert result.potential["n"].ravel().tolist() == [0, 2**11 - 1, 2**11 - 1]
        assert result.counts.spikes == 0

    def test_a_joined_child_adds_its_v_in_the_same_step(self, engine):
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 1)
        soma = builder.add_compartments(
            "soma", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=150
        )
        one = builder.add_compartments(
            "soma/one", 1, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=0, joined_to=soma
        )
        two = builder.add_compartments(
            "soma/two",
            1,
            decay_u=FORGETS_AT_ONCE,
            decay_v=FORGETS_AT_ONCE,
            threshold=0,
            joined_to=one,
        )
        builder.connect(x, one, [[100]])
        builder.connect(x, two, [[100]])
        result = played(builder.build(), [0], 4, engine)
        assert result.v["soma/two"].ravel().tolist() == [0, CHARGE, 0, 0]
        assert result.v["soma/one"].ravel().tolist() == [0, 2 * CHARGE, 2 * CHARGE, 2 * CHARGE]
        assert result.spikes["soma"].ravel().tolist() == [0, 1, 1, 1]
        assert list(result.spikes) == ["soma"]

    def test_a_parent_waits_for_the_longest_line_of_children(self, engine):
        """One child has a child of its own; the other, which comes after it, has none."""
        builder = hw.ProgramBuilder(CHIP)
        x = builder.add_input("x", 1)
        forgets = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
        soma = builder.add_compartments("soma", 1, threshold=250, **forgets)
        one = builder.add_compartments("one", 1, threshold=0, joined_to=soma, **forgets)
        two = builder.add_compartments("two", 1, threshold=0, joined_to=soma, **forgets)
        deep = builder.add_compartments("deep", 1, threshold=0, joined_to=one, **forgets)
        for child in (one, two, deep):
            builder.connect(x, child, [[100]])
        result = played(builder.build(), [0], 3, engine)
        assert result.potential["soma"].ravel().tolist() == [0, 3 * CHARGE, 0]
        assert result.spikes["soma"].ravel().tolist() == [0, 1, 0]

    def test_steps_beyond_the_rows_are_silent_and_rows_beyond_the_steps_are_counted(self, engine):
        program = one_compartment()
        longer = hw.simulate(program, [[1]], steps=4, engine=engine, probe=("v",))
        assert longer.v["n"].ravel().tolist() == [0, CHARGE, CHARGE, CHARGE]
        shorter = hw.simulate(program, [[1], [0], [1], [1]], steps=2, engine=engine)
        assert (shorter.counts.input_events, shorter.counts.events_dropped) == (1, 2)

    def test_spikes_of_the_last_step_are_delivered_but_act_after_the_end(self, engine):
        counts = played(one_compartment(delay=2), [1, 2, 5], 6, engine).counts
        assert (counts.synaptic_ops, counts.synaptic_ops_after_end) == (3, 1)


def test_an_exponent_below_0_floors_weight_by_weight():
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    n = builder.add_compartments(
        "n", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=LARGEST_THRESHOLD
    )
    builder.connect(x, n, [[6, -6]], exponent=-2)
    result = hw.simulate(builder.build(), [[1, 1], [0, 0]], probe=("u",))
    # 6 / 4 and -6 / 4, rounded down each.
    assert result.u["n"].ravel().tolist() == [
        0,
        (1 - 2) * UNIT,
    ]
