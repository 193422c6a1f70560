"""Energy and latency of recordings: counts multiplied by the costs of a profile.

A :class:`hw_model.description.profile.Profile` holds published picojoules and nanoseconds per
operation. Energy is a sum over all operations. Latency is the length of the critical path: all
cores run a step at the same time, and a barrier keeps the next step from beginning before the last
core is done. In a step, each core does this, in this order::

    updates -> sending -> mesh -> deliveries -> synapses
                                  (begin after the last packet to this core has arrived)

A packet leaves after its core has finished updates and sending. It takes the time of its hops, X first, then Y. A link
between two tiles of the mesh passes one packet in the time of a hop, so the packet also waits, on the busiest link of
its way, for all other packets of that step.
"""

import math
from collections.abc import Mapping

import numpy as np

from hw_model.accounting.activity import StepActivity
from hw_model.accounting.mesh_routes import Routes, routes_of
from hw_model.description.counts import Counts
from hw_model.description.profile import Profile
from hw_model.errors import check_known
from hw_model.io.arguments import check_argument, checked
from hw_model.program.chip_program import ChipProgram
from hw_model.values import BoolArray, FloatArray, Frozen, IntArray, Shown

# The operations of each part of a step, by the names of counts.
UPDATES = ("neuron_updates", "neuron_updates_active", "neuron_updates_inactive")
SENDING = ("spikes", "axon_packets", "packets_within_tile")
DELIVERIES = ("packets_received",)
SYNAPSES = ("synaptic_ops",)
PARTS = ("updates", "sending", "mesh", "buffer", "deliveries", "synapses", "barrier")
"""The parts of a step's time on its critical path; ``buffer``: reading events from the transpose buffer."""


@checked
def energy_pj(counts: Counts, profile: Profile) -> dict[str, float]:
    """Return picojoules by operation: each count times its cost, for the counts that the profile has a cost of."""
    return {name: counts[name] * cost for name, cost in profile.energy_pj.items()}


class Latency(Shown):
    """The time of one recording, whose phases run one after the other, without the time of input from the host."""

    total_ns: float
    by_phase_ns: Mapping[str, float]
    critical_core: int
    """The core that finished last in the steps whose times add up to the most."""
    after_last_row_ns: float
    """From the arrival of the last row to the end: its own step, and all phases that need the whole recording."""
    slowest_step_ns: float
    """The longest step for a row of the recording; 0 if no phase plays rows as they arrive."""


class StepTimes(Frozen, eq=False):
    """Where the time of one phase goes, in nanoseconds, arrays (..., steps, cores) or (..., steps, ways).

    - ``work_ns[count]``: the work of a core on each operation
    - ``buffer_ns``: reading the transpose buffer, before the core's deliveries
    - ``mesh_ns``: from leaving a core to arriving at another, on each way; 0 on ways without packets
    - ``used`` (..., steps, ways): whether a way has any packet
    - ``barrier_ns``: from the last core to the end of the step; ``runs`` (..., steps) marks the steps that are run
    """

    routes: Routes
    work_ns: Mapping[str, FloatArray]
    buffer_ns: FloatArray
    mesh_ns: FloatArray
    used: BoolArray
    barrier_ns: float
    runs: BoolArray

    def of(self, counts: tuple[str, ...]) -> FloatArray:
        """Return the time for some operations, (..., steps, cores)."""
        return sum(
            (self.work_ns[name] for name in counts if name in self.work_ns),
            start=np.zeros_like(self.buffer_ns),
        )

    @property
    def sent_ns(self) -> FloatArray:
        """When the last packet of each core leaves it, (..., steps, cores)."""
        return self.of(UPDATES + SENDING)

    @property
    def begin_ns(self) -> FloatArray:
        """When each core begins to handle what has arrived, (..., steps, cores)."""
        begin_ns = self.sent_ns  # a property: a fresh array, which may be changed in place
        # On ways without packets nothing arrives: 0 delays no core.
        arrived_ns = (begin_ns[..., self.routes.source] + self.mesh_ns) * self.used
        np.maximum.at(begin_ns.T, self.routes.target, arrived_ns.T)
        return begin_ns

    @property
    def core_ns(self) -> FloatArray:
        """When each core is done, (..., steps, cores)."""
        return self.begin_ns + self.buffer_ns + self.of(DELIVERIES + SYNAPSES)

    @property
    def step_ns(self) -> FloatArray:
        """Time of each step, (..., steps)."""
        step_ns: FloatArray = self.core_ns.max(axis=-1) + self.barrier_ns * self.runs
        return step_ns


class CriticalPath(Frozen, eq=False):
    """What determines the length of each step, arrays (..., steps).

    ``last`` is the core that finishes last. ``sender`` is the core whose packet it waited for, or itself if it did not
    wait. Both are indices of the phase's cores. The ``parts_ns[part]`` add up to the time of the step.
    """

    last: IntArray
    sender: IntArray
    parts_ns: Mapping[str, FloatArray]

    @property
    def step_ns(self) -> FloatArray:
        """Time of each step."""
        return sum(self.parts_ns.values(), start=np.zeros(self.last.shape))


@checked
def latency(
    program: ChipProgram, activity: Mapping[str, StepActivity], profile: Profile
) -> Latency:
    """Return the time of one recording, given its activity by phase.

    Raises ``InputError`` for an unknown phase.
    """
    known = [phase.name for phase in program.phases]
    for phase, steps in activity.items():
        check_known("latency, activity", f"there is no phase {phase!r}", str(phase), known)
        check_argument("latency", f"activity[{phase!r}]", steps, (StepActivity,))
    paths = {
        phase: critical_path(step_times(program, phase, steps, profile))
        for phase, steps in activity.items()
    }
    return recording_latency(program, paths)


def recording_latency(program: ChipProgram, paths: Mapping[str, CriticalPath]) -> Latency:
    """Return the time of one recording, given its critical path by phase."""
    ns_by_last_core = np.zeros(len(program.cores))
    by_phase_ns: dict[str, float] = {}
    after_last_row_ns = 0.0
    slowest_step_ns = 0.0
    for phase, path in paths.items():
        step_ns = path.step_ns
        by_phase_ns[phase] = float(step_ns.sum())
        plays_rows = any(item.positions is None for item in program.inputs_of(phase))
        if plays_rows:
            # Such a phase runs while rows arrive: only the step of the last row is left at the end.
            after_last_row_ns += float(step_ns[-1])
            slowest_step_ns = max(slowest_step_ns, float(step_ns.max()))
        else:
            after_last_row_ns += by_phase_ns[phase]
        # From indices of the phase's cores to those of the program.
        numbers = np.array([core.number for core in program.cores_of(phase)])
        np.add.at(ns_by_last_core, numbers[path.last], step_ns)
    return Latency(
        total_ns=math.fsum(by_phase_ns.values()),
        by_phase_ns=by_phase_ns,
        critical_core=int(ns_by_last_core.argmax()),
        after_last_row_ns=after_last_row_ns,
        slowest_step_ns=slowest_step_ns,
    )


def step_times(
    program: ChipProgram, phase: str, steps: StepActivity, profile: Profile
) -> StepTimes:
    """Return the times of every step, core and way of a phase: counts multiplied by times."""
    chip = program.chip
    cores = program.cores_of(phase)
    routes = routes_of(program, phase)
    tiles_in_use = len({chip.tile_of(core.slot) for core in cores})
    event_ns = chip.transpose_buffer.cycles_per_event / chip.clock_ghz
    buffer_ns = steps.buffered * event_ns
    # Hops of different packets overlap in time: `_mesh_ns` computes them way by way.
    work_ns = {
        name: steps.count(name).astype(np.float64) * cost_ns
        for name, cost_ns in profile.time_ns.items()
        if name not in ("hops_x", "hops_y")
    }
    return StepTimes(
        routes=routes,
        work_ns=work_ns,
        buffer_ns=np.repeat(buffer_ns[..., None], len(cores), axis=-1),
        mesh_ns=_mesh_ns(routes, steps.packets, profile),
        used=steps.packets > 0,
        barrier_ns=profile.barrier_ns.ns(tiles_in_use, chip.mesh.tiles),
        runs=np.asarray(steps.by_piece["neuron_updates"].any(axis=-1)),
    )


def critical_path(times: StepTimes) -> CriticalPath:
    """Return the critical path of every step.

    It is followed backwards: from the core that finishes last to the packet that it waited for, and to its sender.
    """
    last = times.core_ns.argmax(axis=-1)
    routes = times.routes
    sent_ns = times.sent_ns
    sender = last.copy()
    mesh_ns = np.zeros(last.shape)
    # Without a packet that arrives later, the last core begins as soon as its own work is done.
    latest = _at(sent_ns, last)
    for way in np.flatnonzero(routes.source != routes.target):
        arrived = sent_ns[..., routes.source[way]] + times.mesh_ns[..., way]
        decides = times.used[..., way] & (routes.target[way] == last) & (arrived > latest)
        latest = np.where(decides, arrived, latest)
        sender = np.where(decides, routes.source[way], sender)
        mesh_ns = np.where(decides, times.mesh_ns[..., way], mesh_ns)
    parts = {
        "updates": _at(times.of(UPDATES), sender),
        "sending": _at(times.of(SENDING), sender),
        "mesh": mesh_ns,
        "buffer": _at(times.buffer_ns, last),
        "deliveries": _at(times.of(DELIVERIES), last),
        "synapses": _at(times.of(SYNAPSES), last),
        "barrier": times.barrier_ns * times.runs,
    }
    assert tuple(parts) == PARTS  # sums and reports list the parts in this order
    return CriticalPath(last, sender, parts)


def _mesh_ns(routes: Routes, packets: IntArray, profile: Profile) -> FloatArray:
    """Return the time on each way in each step, (..., steps, ways): its hops, and waiting on its busiest link."""
    cost_x = profile.time_ns.get("hops_x", 0.0)
    cost_y = profile.time_ns.get("hops_y", 0.0)
    has_packets = packets > 0
    mesh_ns: FloatArray = has_packets.astype(np.float64) * (
        routes.hops[:, 0] * cost_x + routes.hops[:, 1] * cost_y
    )
    if routes.links:
        cost_of_link = np.where(routes.along_y, cost_y, cost_x)
        # A packet waits for all others of the step on a link, but not for itself.
        waits = np.maximum(routes.loads(packets) - 1, 0) * cost_of_link
        # The last column stands for no link: it is what the -1 after a way's last link refers to.
        waits = np.concatenate((waits, np.zeros((*waits.shape[:-1], 1))), axis=-1)
        longest = np.zeros(packets.shape)
        # The first links of all ways, then their second ones, and so on.
        for k in range(routes.over.shape[1]):
            np.maximum(longest, waits[..., routes.over[:, k]], out=longest)
        mesh_ns = mesh_ns + has_packets * longest
    return mesh_ns


def _at(values: FloatArray, core: IntArray) -> FloatArray:
    """Return, for each step, the value of the core with the index given for it, (..., steps)."""
    return np.take_along_axis(values, core[..., None], axis=-1)[..., 0]
