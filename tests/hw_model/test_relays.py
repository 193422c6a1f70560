"""Delays longer than a chip has: the message says how many relays make one, and so many give the same spikes."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from tests.support.register_units import FORGETS_AT_ONCE

LOIHI = hw.chip("loihi-sim")
LINES, SIZE = 6, 5


def chip(delay_max):
    """Return loihi-sim with another longest delay."""
    return replace(LOIHI, registers=replace(LOIHI.registers, delay_max=delay_max))


def relayed(builder, source, target, weights, delay, relays):
    """Connect through a chain of relays, and divide the delay evenly between its connections.

    Each relay takes a step itself.
    """
    delay_left = delay - relays
    connections = relays + 1
    links = [delay_left // connections + (i < delay_left % connections) for i in range(connections)]
    at = source
    for i, steps in enumerate(links[:-1]):
        relay = builder.add_compartments(
            f"{source.name}{i}",
            at.size,
            decay_u=FORGETS_AT_ONCE,
            decay_v=FORGETS_AT_ONCE,
            threshold=1,
        )
        builder.connect(at, relay, 2 * np.eye(at.size, dtype=int), delay=steps)
        at = relay
    builder.connect(at, target, weights, delay=links[-1])


def program(delay_max, delay, relays, seed=0):
    """Build a network with a delay from its input and one in a loop, among synapses without delays."""
    r = np.random.default_rng(seed)
    builder = hw.ProgramBuilder(chip(delay_max))
    x = builder.add_input("x", LINES)
    n = builder.add_compartments("n", SIZE, decay_u=1500, decay_v=300, threshold=150)
    m = builder.add_compartments("m", SIZE, decay_u=2000, decay_v=200, threshold=150)
    ahead, back, late, direct = (
        2 * r.integers(-60, 100, (SIZE, w)) for w in (SIZE, SIZE, LINES, LINES)
    )
    builder.connect(n, m, ahead)
    builder.connect(x, m, direct)
    relayed(builder, x, n, late, delay, relays)
    relayed(builder, m, n, back, delay, relays)
    return builder.build()


@pytest.mark.parametrize("delay", [1, 3, 6, 17])
@pytest.mark.parametrize("delay_max", [0, 1, 2, 5])
def test_relays_give_the_same_spikes_as_a_delay(delay_max, delay):
    relays = delay // (delay_max + 1)
    spikes = (np.random.default_rng(delay).random((2, 60, LINES)) < 0.25).astype(np.uint8)
    expected = hw.simulate(program(62, delay, 0), spikes).spikes
    shorter = hw.simulate(program(62, delay - 1, 0), spikes).spikes
    assert not np.array_equal(expected["n"], shorter["n"])
    for engine in ("fast", "reference"):
        result = hw.simulate(program(delay_max, delay, relays), spikes, engine=engine).spikes
        assert all(np.array_equal(result[name], expected[name]) for name in "nm")


@pytest.mark.parametrize(
    ("delay_max", "delay", "measured", "fix"),
    [
        (
            0,
            1,
            "1 against 0..0 steps; 1 of 2 delays outside",
            "Relay the spike through 1 compartment, or shorten the delay.",
        ),
        (
            0,
            17,
            "17 against 0..0 steps; 1 of 2 delays outside",
            "Relay the spike through 17 compartments, or shorten the delay.",
        ),
        (
            5,
            11,
            "11 against 0..5 steps; 1 of 2 delays outside",
            "Relay the spike through 1 compartment, or shorten the delay.",
        ),
        (
            5,
            12,
            "12 against 0..5 steps; 1 of 2 delays outside",
            "Relay the spike through 2 compartments, or shorten the delay.",
        ),
        (5, -1, "-1 against 0..5 steps; 1 of 2 delays outside", "Give 0 or more."),
    ],
    ids=["one", "many", "last of one", "first of two", "negative"],
)
def test_the_message_for_a_long_delay_counts_the_relays_it_takes(delay_max, delay, measured, fix):
    builder = hw.ProgramBuilder(chip(delay_max))
    x = builder.add_input("x", 2)
    n = builder.add_compartments("n", 1, threshold=1)
    builder.connect(x, n, [[2, 2]], delay=[[0, delay]])
    with pytest.raises(hw.TargetError) as caught:
        builder.build()
    assert str(caught.value) == f"synapses 'x' -> 'n': a delay is out of range ({measured}). {fix}"


def test_the_message_names_the_longest_delay():
    builder = hw.ProgramBuilder(chip(2))
    x = builder.add_input("x", 3)
    n = builder.add_compartments("n", 1, threshold=1)
    builder.connect(x, n, [[2, 2, 2]], delay=[[4, 9, 2]])
    with pytest.raises(hw.TargetError) as caught:
        builder.build()
    assert str(caught.value) == (
        "synapses 'x' -> 'n': a delay is out of range (9 against 0..2 steps; 2 of 3 delays outside). "
        "Relay the spike through 3 compartments, or shorten the delay."
    )
