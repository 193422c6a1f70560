"""Bound in closed form how far the registers of a population can get, if every source spikes at most once in p steps.

The compiler uses the bounds to choose weights that cannot wrap or saturate, and reports the smallest safe period p.

Weights are not negative, so a current lies between 0 and its largest possible value. In every step, V moves towards a
*goal*, the value to which the present current would take it; so V lies between the lowest and the highest goal, or at
the value that it began with or was reset to. The bounds are Python integers of any size, so they cannot wrap
themselves.

With p = 1, every source spikes in every step, which no recording exceeds. With a larger p, the current gets highest if
all weights arrive in the same step, and again every p steps; in between it decays p times. A current is highest right
after an arrival, when it also drives V. The chip rounds down on the way, which only makes the current smaller.

The formulas and their letters are those of :mod:`hw_model.arithmetic.spinnaker`. Its ``HALF_SPAN`` is 2^31, where
signed numbers of 32 bits end, and ``SPAN`` 2^32, which is 1 in the format u0.32.
"""

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic.spinnaker import EXCITATORY, HALF_SPAN, INHIBITORY, RING_MAX, SPAN
from hw_model.range_proof import PERIODS
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.values import AnyArray, Frozen, IntArray


class Reach(Frozen, eq=False):
    """The largest magnitudes that the registers of n neurons can reach, as arrays of Python integers.

    s16.15 is a signed fixed-point number of 32 bits, of which 15 are fractional.

    - ``ring`` (n, receptors): the sum of stored weights that arrive in a step
    - ``shifted_ring`` (n, receptors): that sum after its shift, s16.15 nA
    - ``current`` (n, receptors): the synaptic current right after an arrival, s16.15 nA
    - ``drive`` (n,): the total current that moves V, s16.15 nA
    - ``goal`` (n,): the value that V moves towards, s16.15 mV
    - ``distance`` (n,): the distance between V and its goal, s16.15 mV
    """

    ring: AnyArray
    shifted_ring: AnyArray
    current: AnyArray
    drive: AnyArray
    goal: AnyArray
    distance: AnyArray

    @property
    def saturates(self) -> bool:
        """Whether a ring buffer may saturate: False is proven, True is only possible."""
        return bool((self.ring > RING_MAX).any())

    @property
    def wraps(self) -> bool:
        """Whether a sum may wrap: False is proven, True is only possible."""
        sums = (self.shifted_ring, self.current, self.drive, self.goal, self.distance)
        return any(bool((largest >= HALF_SPAN).any()) for largest in sums)

    @property
    def fits(self) -> bool:
        """Whether nothing can saturate or wrap."""
        return not self.saturates and not self.wraps

    @property
    def ring_share(self) -> float:
        """The largest entry of a ring buffer, as a share of the largest that does not saturate."""
        return float(self.ring.max()) / RING_MAX

    @property
    def current_share(self) -> float:
        """The largest current or drive, as a share of the largest s16.15 number."""
        largest = max(int(self.current.max()), int(self.drive.max()))
        return largest / HALF_SPAN

    @property
    def potential_share(self) -> float:
        """The largest goal or distance, as a share of the largest s16.15 number."""
        largest = max(int(self.goal.max()), int(self.distance.max()))
        return largest / HALF_SPAN


def safe_period(network: SpinnakerNetwork, name: str) -> int:
    """Return the smallest period at which nothing in a population can saturate or wrap.

    Every source spikes at most once in a period. The result is one of :data:`hw_model.range_proof.PERIODS`: 1 if the
    population is safe with any input, 0 if it is not safe even at the longest period.
    """
    for period in PERIODS:  # shortest first
        if reach_of(network, name, period).fits:
            return period
    return 0


def reach_of(network: SpinnakerNetwork, name: str, period: int = 1) -> Reach:
    """Return how far the registers of a population can get.

    Every source spikes at most once in ``period`` steps. With a period above 1, currents and what follows from them
    are bounds only if no ring buffer saturates: otherwise, weights that arrive in different steps can add up to more.
    """
    population = network.population(name)
    parameters = population.parameters
    # Arrays of dtype object hold Python integers, which do not overflow.
    ring = _weights_of_a_step(network, population).astype(object)
    # A ring buffer saturates at RING_MAX, and the core shifts what is left.
    shifted_ring = np.minimum(ring, RING_MAX) * 2 ** np.array(population.shifts, dtype=object)
    current = _largest_current(population, shifted_ring, period)

    offset = parameters.i_offset.astype(object)
    highest_drive = current[:, EXCITATORY] + offset
    lowest_drive = offset - current[:, INHIBITORY]
    resistance = population.constants.resistance.astype(object)
    v_rest = parameters.v_rest.astype(object)
    goals = [
        spinnaker.goal_of(lowest_drive, resistance, v_rest),
        spinnaker.goal_of(highest_drive, resistance, v_rest),
    ]
    # A resistance that wrapped when the core started may be negative: then the lowest drive has the highest goal.
    lowest_goal = np.minimum(*goals)
    highest_goal = np.maximum(*goals)
    v_reset = parameters.v_reset.astype(object)
    v_init = parameters.v_init.astype(object)
    lowest_v = np.minimum.reduce([lowest_goal, v_reset, v_init])
    highest_v = np.maximum.reduce([highest_goal, v_reset, v_init])
    return Reach(
        ring=ring,
        shifted_ring=shifted_ring,
        current=current,
        drive=np.maximum(abs(lowest_drive), abs(highest_drive)),
        goal=np.maximum(abs(lowest_goal), abs(highest_goal)),
        distance=np.maximum(highest_goal - lowest_v, highest_v - lowest_goal),
    )


def _weights_of_a_step(network: SpinnakerNetwork, population: SpinnakerPopulation) -> IntArray:
    """Return the sum of all weights per neuron and receptor, (n, receptors): the most that can arrive in a step."""
    sums = np.zeros((population.size, spinnaker.RECEPTOR_COUNT), dtype=np.int64)
    for projection in network.projections:
        if projection.target == population.name:
            receptor = RECEPTORS.index(projection.receptor)
            np.add.at(sums[:, receptor], projection.target_index, projection.weight)
    return sums


def _largest_current(
    population: SpinnakerPopulation, shifted_ring: AnyArray, period: int
) -> AnyArray:
    """Return the largest possible current, (n, receptors).

    A step first adds the weights that arrive, then moves V, and then lets the current decay by the factor d. Let A be
    the most that arrives in a step. The bound I is the smallest integer with

        I (1 - d^p) >= A

    If the current is at most I right after an arrival, it has decayed to I d^p at most before the next one, p steps
    later, and right after that it is I d^p + A <= I at most.
    """
    constants = population.constants
    # Only a share of the weights reaches the current at once: ``synapse_init``, in u0.32.
    added = constants.synapse_init.astype(object) * shifted_ring // SPAN
    # The decay is stored as an integer d * SPAN, so d^p is (stored decay)^p / SPAN^p.
    one = SPAN**period
    lost = one - constants.synapse_decay.astype(object) ** period
    # Division rounded up: -(-a // b).
    current: AnyArray = -(-added * one // lost)
    return current
