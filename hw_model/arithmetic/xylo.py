"""The arithmetic of SynSense's Xylo chips (Audio 2, Audio 3, IMU) on one page. Read it from top to bottom.

It is the only definition of a step: the engines and checks of :mod:`hw_model.xylo` use the functions below.

REGISTERS of a neuron; all are 0 at rest, and hold 16 bits of which one is the sign.

    i_k       synaptic currents, k = 1 or 2     saturate at every single addition
    v         membrane potential                saturates

PARAMETERS of a neuron

    dash_syn_k, dash_mem    0..15               a decay takes away x >> dash
    threshold               1..32767
    bias                    -32768..32767, or None where the biases of the chip are off

SYNAPSES hold weights of 8 bits, -128..127. A charge is weight << shift, wrapped to 16 bits. A chip has three shifts in
all: one for synapses from input lines, one for those between hidden neurons, and one for those onto outputs. An input
line counts at most 15 events of a row, and further ones are lost.

WHEN: a row is one step of the recording. Events of row t act in row t, and spikes that a hidden neuron sends in row t
act in row t + 1, in hidden neurons and in outputs alike. There are no delays and no refractory steps.

THE STEP, in the order of the code below:

    i_k     = saturate(i_k + charge)        for each event and spike, one after the other: the order matters
    i_k     = i_k - taken(i_k, dash_syn_k)
    change  = saturate(wrap(-taken(v, dash_mem)) + sum over k of i_k), and saturate(change + bias) where there is one
    v       = saturate(v + change)
    spikes  = how often the threshold fits into v: up to 31 for a hidden neuron, up to 1 for an output
    v       = v - spikes threshold

    taken(x, dash) = x >> dash, rounded down; where that is 0, the sign of x, so that x comes one unit closer to 0

An ALIAS of a hidden neuron n is another hidden neuron that repeats the spikes of n, in addition to spikes of its own,
up to 31 in all. Neurons fire in the order of their numbers, one after the other:

- an alias with a higher number than n fires after n. The repeated spikes leave it less room for its own, and its own
  aliases repeat them as well, in a chain
- an alias with a lower number has fired already. It adds the repeated spikes as far as there is room, but does not
  hand them on to its own aliases

EVENTS that are counted: additions to a current, a change or a potential that saturated; input events that were lost.

From this page follows :mod:`hw_model.arithmetic.xylo_inverse`, which finds the settings for a trained network.
"""

from typing import NamedTuple

import numpy as np

from hw_model.values import FloatArray, IntArray

STATE_MIN = -(1 << 15)
STATE_MAX = (1 << 15) - 1
WEIGHT_BITS = 8
WEIGHT_MIN = -128
WEIGHT_MAX = 127
DASH_MAX = 15
INPUT_EVENTS_MAX = 15
HIDDEN_SPIKES_MAX = 31
OUTPUT_SPIKES_MAX = 1
EVENTS = ("current_saturations", "change_saturations", "potential_saturations", "lost_input_events")
"""What is counted, by name."""


class Parameters(NamedTuple):
    """Of n neurons with k currents each: dash_syn (n, k), all others (n,)."""

    dash_syn: IntArray
    dash_mem: IntArray
    threshold: IntArray
    bias: IntArray | None


class State(NamedTuple):
    """Registers between two steps: currents (n, k), potentials (n,)."""

    i: IntArray
    v: IntArray


class Counted(NamedTuple):
    """A state, and how often anything saturated on the way to it."""

    state: State
    saturations: dict[str, int]


def collect(i: IntArray, spikes: IntArray, charges: IntArray) -> tuple[IntArray, int]:
    """Add ``charges`` (sources, n, k) of ``spikes`` (sources,) to the currents, source by source, spike by spike.

    Returns the currents, and how many additions saturated.
    """
    saturated = 0
    # A current saturates at every single addition, so adding the sum over all spikes would give another number.
    for source in np.flatnonzero(spikes):
        for _ in range(spikes[source]):
            exact = i + charges[source]
            i = saturate(exact)
            saturated += int(np.count_nonzero(i != exact))
    return i, saturated


def respond(p: Parameters, state: State) -> Counted:
    """Let currents and potentials decay, and add the currents and the bias to the potentials."""
    i = decayed(state.i, p.dash_syn)
    exact = change_of(state.v, p.dash_mem, i.sum(axis=1))
    change = saturate(exact)
    changes_saturated = np.count_nonzero(change != exact)
    if p.bias is not None:
        exact = change + p.bias
        change = saturate(exact)
        changes_saturated += np.count_nonzero(change != exact)
    v_sum = state.v + change
    v = saturate(v_sum)
    saturations = {
        "change_saturations": int(changes_saturated),
        "potential_saturations": int(np.count_nonzero(v != v_sum)),
    }
    return Counted(State(i, v), saturations)


def decayed(i: IntArray, dash_syn: IntArray) -> IntArray:
    """Return currents after the decay of a step."""
    return i - taken(i, dash_syn)


def change_of(v: IntArray, dash_mem: IntArray, currents: IntArray) -> IntArray:
    """Return what a step adds to potentials, before it saturates. ``currents`` are sums over k.

    The wrap matters for v = -32768 with dash 0 only: 32768 does not fit 16 bits.
    """
    return wrap(-taken(v, dash_mem)) + currents


def fire(v: IntArray, threshold: IntArray, room: IntArray | int) -> tuple[IntArray, IntArray]:
    """Return the spikes of a step, at most ``room``, and the potentials after them.

    Each spike subtracts the threshold, which is positive. So a division gives the number of spikes, and no difference
    leaves the register.
    """
    spikes: IntArray = np.minimum(np.maximum(v, 0) // threshold, room)
    return spikes, v - spikes * threshold


def fire_with_aliases(
    v: IntArray, threshold: IntArray, aliases: tuple[tuple[int, ...], ...]
) -> tuple[IntArray, IntArray]:
    """Return the spikes of a step and the potentials after them for hidden neurons, which fire one after the other.

    ``aliases[n]`` are the neurons that repeat the spikes of neuron n.
    """
    spikes = np.zeros(len(v), dtype=np.int64)
    remaining_v = v.copy()
    for n in range(len(v)):
        # ``spikes[n]`` already holds the spikes that n repeats as an alias of earlier neurons.
        own_spikes, remaining_v[n] = fire(v[n], threshold[n], HIDDEN_SPIKES_MAX - spikes[n])
        spikes[n] += own_spikes
        for alias in aliases[n]:
            # All spikes of n, own and repeated. An alias with a lower number than n has fired already: repeated
            # spikes cost it no potential, and are not passed on.
            spikes[alias] = min(HIDDEN_SPIKES_MAX, spikes[alias] + spikes[n])
    return spikes, remaining_v


def saturate(x: IntArray) -> IntArray:
    """Return the nearest value that a register can hold."""
    return np.minimum(np.maximum(x, STATE_MIN), STATE_MAX)


def wrap(x: IntArray) -> IntArray:
    """Return the low 16 bits of x in two's complement."""
    span = STATE_MAX - STATE_MIN + 1
    return (x - STATE_MIN) % span + STATE_MIN


def taken(x: IntArray, dash: IntArray) -> IntArray:
    """Return what a decay subtracts: x >> dash or, where that is 0, one unit with the sign of x.

    Without this unit, a small positive register would stay where it is. With it, every register reaches 0 at last.
    """
    shifted = x >> dash
    lost: IntArray = shifted + np.sign(x) * (shifted == 0)
    return lost


def charge_of(weight: IntArray, shift: int) -> IntArray:
    """Return the charge that a spike adds to a current through a synapse of this weight."""
    return wrap(weight << shift)


def share_lost(dash: IntArray) -> FloatArray:
    """Return the share of its value, 2^-dash, that a current or potential loses in a step, ignoring rounding."""
    lost: FloatArray = 2.0 ** -np.asarray(dash, dtype=np.float64)
    return lost
