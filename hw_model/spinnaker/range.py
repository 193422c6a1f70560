"""How far registers of a population can get, in closed form, if each source spikes once in p steps.

Weights are not negative, so that a current lies between 0 and the largest that it can be; V lies
between the least and the greatest goal, or where it began or was reset to. The bounds are exact
integers of any size: what they say does not wrap itself.

With p = 1, a source spikes in every step, which no recording exceeds. With longer p, all weights
still arrive at once at worst, then the current decays for p steps; to round down on the way only
makes it smaller.
"""

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic.spinnaker import EXCITATORY, HALF_SPAN, INHIBITORY, RING_MAX, SPAN
from hw_model.range_proof import PERIODS
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.values import AnyArray, Frozen, IntArray


class Reach(Frozen, eq=False):
    """The largest magnitudes that n neurons can reach, arrays of Python's integers.

    - ``ring`` (n, receptors): stored weights of a step
    - ``shifted_ring`` (n, receptors): what a shift makes of them, s16.15 nA
    - ``current`` (n, receptors): s16.15 nA
    - ``drive`` (n,): what moves V, s16.15 nA
    - ``goal`` (n,): where to, s16.15 mV
    - ``distance`` (n,): how far that can be from V, s16.15 mV
    """

    ring: AnyArray
    shifted_ring: AnyArray
    current: AnyArray
    drive: AnyArray
    goal: AnyArray
    distance: AnyArray

    @property
    def saturates(self) -> bool:
        """Whether the bounds do not exclude that a weight saturates a ring buffer."""
        return bool((self.ring > RING_MAX).any())

    @property
    def wraps(self) -> bool:
        """Whether the bounds do not exclude that a sum wraps."""
        sums = (self.shifted_ring, self.current, self.drive, self.goal, self.distance)
        return any(bool((largest >= HALF_SPAN).any()) for largest in sums)

    @property
    def fits(self) -> bool:
        """Whether nothing can saturate or wrap."""
        return not self.saturates and not self.wraps

    @property
    def ring_share(self) -> float:
        """The fullest entry of a ring buffer, as a share of what saturates none."""
        return float(self.ring.max()) / RING_MAX

    @property
    def current_share(self) -> float:
        """The largest current or drive, as a share of where s16.15 ends."""
        largest = max(int(self.current.max()), int(self.drive.max()))
        return largest / HALF_SPAN

    @property
    def potential_share(self) -> float:
        """The furthest goal, or the longest way to one, as a share of where s16.15 ends."""
        largest = max(int(self.goal.max()), int(self.distance.max()))
        return largest / HALF_SPAN


def safe_period(network: SpinnakerNetwork, name: str) -> int:
    """Return the fewest steps between two spikes of a source at which a population fits.

    It is one of :data:`hw_model.range_proof.PERIODS`: 1 if nothing can saturate or wrap whatever the
    input, 0 if none of them is enough.
    """
    for period in PERIODS:
        if reach_of(network, name, period).fits:
            return period
    return 0


def reach_of(network: SpinnakerNetwork, name: str, period: int = 1) -> Reach:
    """Return how far the registers of a population can get.

    Every source spikes at most once in ``period`` steps.
    """
    population = network.population(name)
    parameters = population.parameters
    ring = _weights_of_a_step(network, population).astype(object)
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
    # A resistance that wrapped may be negative: then the lowest drive has the highest goal.
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
    """Return the most that a step can bring to every neuron and receptor, (n, receptors)."""
    sums = np.zeros((population.size, spinnaker.RECEPTORS), dtype=np.int64)
    for projection in network.projections:
        if projection.target == population.name:
            receptor = RECEPTORS.index(projection.receptor)
            np.add.at(sums[:, receptor], projection.target_index, projection.weight)
    return sums


def _largest_current(
    population: SpinnakerPopulation, shifted_ring: AnyArray, period: int
) -> AnyArray:
    """Return the current, (n, receptors), that loses in a period what a step can bring.

    It is the least integer I with I (1 - d^p) at or above what comes in a step: no current passes it.
    """
    constants = population.constants
    added = constants.synapse_init.astype(object) * shifted_ring // SPAN
    whole = SPAN**period
    lost = whole - constants.synapse_decay.astype(object) ** period
    current: AnyArray = -(-added * whole // lost)
    return current
