"""The step of a compartment alone: :mod:`hw_model.arithmetic.loihi` on numbers of 32 bits, for compiled loops.

A loop over compartments that takes these in runs in vectors, as one over chunks does; but here q is in whole units of
64 and everything else may have registers of any width up to 29 bits. Truths are 0 or 1.
"""

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import EVENTS, Parameters, Response, State, Truth
from hw_model.arithmetic.neutral import ALWAYS
from hw_model.engine.chunks import OnLanes
from hw_model.engine.lanes import Lanes
from hw_model.engine.private_numba import of_numbers

Numbers = tuple[Lanes, ...]


@of_numbers("u, v, charge, keep, last, half_charge, half_current", returns=2 + len(EVENTS))
def dendrite(  # noqa: PLR0913 - registers and parameters of a step, by name
    u: Lanes,
    v: Lanes,
    charge: Lanes,
    keep: Lanes,
    last: Lanes,
    half_charge: Lanes,
    half_current: Lanes,
) -> Numbers:
    """Take the step of a compartment without threshold or bias: return u, v, and which events it met."""
    nothing = charge & 0
    p = Parameters(keep, keep, nothing, last, nothing, -last, last)
    response = loihi.respond(OnLanes((half_charge, half_current)), p, u, v, charge, nothing)
    return response.u, response.v, *_met(response, ALWAYS, nothing)


@of_numbers("joined, threshold, last, half_charge, half_current", returns=2 + len(EVENTS))
def sum_of_joined(
    joined: Lanes, threshold: Lanes, last: Lanes, half_charge: Lanes, half_current: Lanes
) -> Numbers:
    """Take the step of a compartment that keeps nothing: return v at the threshold, spikes, and which events it met."""
    nothing = joined & 0
    p = Parameters(nothing, nothing, nothing, threshold, nothing + 1, -last, last)
    at_rest = State(nothing, nothing, nothing)
    step = loihi.step(OnLanes((half_charge, half_current)), p, at_rest, nothing, joined)
    return step.potential, step.fired, *_met(step.response, step.live, nothing)


@of_numbers(
    "u, v, blocked, charge, keep, threshold, refractory, last, half_charge, half_current",
    returns=6 + len(EVENTS),
)
def compartment(  # noqa: PLR0913 - registers and parameters of a step, by name
    u: Lanes, v: Lanes, blocked: Lanes, charge: Lanes, keep: Lanes, threshold: Lanes, refractory: Lanes,
    last: Lanes, half_charge: Lanes, half_current: Lanes,
) -> Numbers:  # fmt: skip
    """Take the step of a compartment without bias or children.

    Return u, v, blocked, v at the threshold, spikes, which are not blocked, and which events it met.
    """
    nothing = charge & 0
    p = Parameters(keep, keep, nothing, threshold, refractory, -last, last)
    ops = OnLanes((half_charge, half_current))
    step = loihi.step(ops, p, State(u, v, blocked), charge, nothing)
    met = _met(step.response, step.live, nothing)
    return *step.state, step.potential, step.fired, step.live, *met


def _met(response: Response, live: Truth, nothing: Lanes) -> list[Lanes]:
    """Return how often every event was met, in the order of :data:`EVENTS`."""
    counts = dict.fromkeys(EVENTS, nothing)
    for event, met in loihi.events(response, live):
        counts[event] = counts[event] + met
    return list(counts.values())
