"""The step of a single compartment, :mod:`hw_model.arithmetic.loihi` on 32-bit numbers, for compiled loops.

The fast engine does not use it: it is for loops over compartments that do not lie in chunks of 16, such as those of
networks in training (:mod:`locsnn_compile.models.chip_layers`). These functions become part of such a loop, and LLVM
then runs it in vectors. Conditions are returned as 0 or 1.

Arguments that every function has, in the letters of the page of the arithmetic:

- ``charge``: the charge that acts in this step, in whole units of 64. Its register q wraps to
  ``-half_charge..half_charge - 1``.
- ``half_current``: u, and u + bias, wrap to ``-half_current..half_current - 1``
- ``last``: v is clipped to ``-last..last``

Registers may have any width up to 29 bits (:data:`locsnn_compile.models.chip_entry.TRAINED_BITS`): the sum of two of
them, such as the v that is kept and u, then fits 32 bits with one to spare.

``charge & 0`` makes a 0 of the type of the arguments, a value of the compiled loop; a plain 0 of Python is none.
"""

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import EVENTS, Parameters, Response, State, Truth
from hw_model.arithmetic.neutral import ALWAYS
from hw_model.engine.chunks import OnLanes
from hw_model.engine.lanes import Lanes
from hw_model.engine.private_numba import of_numbers

Numbers = tuple[Lanes, ...]
"""What a function returns to a loop: as many 32-bit numbers as its decorator says."""


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
    """Run a step of a compartment without threshold or bias; return u, v, and how often it met each event.

    ``keep`` is the share that u and v keep, in 4096ths, and v is clipped to ``-last..last``.
    """
    nothing = charge & 0
    # v never exceeds the threshold `last`, so there are no spikes.
    p = Parameters(
        keep_u=keep,
        keep_v=keep,
        bias=nothing,
        threshold=last,
        refractory=nothing,
        vmin=-last,
        vmax=last,
    )
    # Only what happens before the threshold: the rest of a step would change nothing.
    response = loihi.respond(OnLanes((half_charge, half_current)), p, u, v, charge, nothing)
    return response.u, response.v, *_event_counts(response, ALWAYS, nothing)


@of_numbers("joined, threshold, last, half_charge, half_current", returns=2 + len(EVENTS))
def sum_of_joined(
    joined: Lanes, threshold: Lanes, last: Lanes, half_charge: Lanes, half_current: Lanes
) -> Numbers:
    """Run a step of a compartment that is only the sum of its children.

    Return v as it was compared with the threshold, whether it spikes, and how often it met each event. It has no
    memory, so it starts at rest, and its state after the step is not returned.
    """
    nothing = joined & 0
    p = Parameters(
        keep_u=nothing,
        keep_v=nothing,
        bias=nothing,
        threshold=threshold,
        # The least there is: the compartment may spike in every step.
        refractory=nothing + 1,
        vmin=-last,
        vmax=last,
    )
    at_rest = State(nothing, nothing, nothing)
    step = loihi.step(OnLanes((half_charge, half_current)), p, at_rest, nothing, joined)
    return step.potential, step.fired, *_event_counts(step.response, step.live, nothing)


@of_numbers(
    "u, v, blocked, charge, keep, threshold, refractory, last, half_charge, half_current",
    returns=6 + len(EVENTS),
)
def compartment(  # noqa: PLR0913 - registers and parameters of a step, by name
    u: Lanes, v: Lanes, blocked: Lanes, charge: Lanes, keep: Lanes, threshold: Lanes, refractory: Lanes,
    last: Lanes, half_charge: Lanes, half_current: Lanes,
) -> Numbers:  # fmt: skip
    """Run a step of a compartment without bias or children.

    Return u, v, blocked, v as it was compared with the threshold, whether it spikes, whether it was not blocked, and
    how often it met each event.
    """
    nothing = charge & 0
    p = Parameters(
        keep_u=keep,
        keep_v=keep,
        bias=nothing,
        threshold=threshold,
        refractory=refractory,
        vmin=-last,
        vmax=last,
    )
    ops = OnLanes((half_charge, half_current))
    step = loihi.step(ops, p, State(u, v, blocked), charge, nothing)
    counts = _event_counts(step.response, step.live, nothing)
    return *step.state, step.potential, step.fired, step.live, *counts


def _event_counts(response: Response, live: Truth, nothing: Lanes) -> list[Lanes]:
    """Return how often each event was met in the step, in the order of :data:`EVENTS`: wraps of q and u, clips of v."""
    counts = dict.fromkeys(EVENTS, nothing)
    for event, met in loihi.events(response, live):
        counts[event] = counts[event] + met
    return list(counts.values())
