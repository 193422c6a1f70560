"""Find out what SANA-FE's neurons cannot compute of a program, and count updates as SANA-FE does.

Its soma computes, in units of :mod:`hw_model.arithmetic.loihi`: ``u = input_decay * u + charge``,
``v = trunc(leak_decay * v) + bias + u``, and a spike if ``v > threshold``. It truncates v as the chip does, but never
u. So it finds the same spikes if no fraction of a current is ever cut off, and if the program uses nothing that its
neurons lack. A phase for which this does not hold is replayed: its spikes are given, and SANA-FE only counts.
"""

from collections.abc import Callable

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi, loihi_bounds
from hw_model.program.chip_program import Core
from hw_model.values import BoolArray
from locsnn_compile.backends.played import Played

DELAY_MAX = 5
"""Most steps of a delay: its dendrites with delays hold six slots (``AccumulatorWithDelayModel``)."""
UNIT_SIZE = 1024
"""Compartments in one of its soma or dendrite units."""
AFTER_SPIKE = loihi.in_units(0.5)
"""Voltage after a spike, in units: half of what truncation keeps, so it becomes 0 before it is used.

With a voltage of exactly 0, SANA-FE would consider the compartment idle in the next step, although it has a current.
"""


def obstacles(played: Played, phase: str) -> list[str]:
    """Return the reasons why SANA-FE's neurons would not find the spikes of a phase; none if they do.

    Each reason has its number of cases. Settings are checked in the program, and registers in the recording.
    """
    cores = played.program.cores_of(phase)
    events = [played.result.events.get(group, {}) for group in played.program.columns_of(phase)]

    def count(is_obstacle: Callable[[Core], BoolArray]) -> int:
        return sum(int(is_obstacle(core).sum()) for core in cores)

    count_by_reason = {
        "joined compartments, of which its neurons have none": count(lambda core: core.parent >= 0),
        "refractory periods, in which it loses charge that arrives": count(
            lambda core: core.setting("refractory") > 1
        ),
        f"delays above {DELAY_MAX} steps": count(lambda core: core.axons.delay > DELAY_MAX),
        "upper voltage limits not above the threshold; it has no upper limit": count(
            lambda core: core.vmax <= core.threshold_voltage
        ),
        "wraps of registers in this recording; it has none": sum(
            group_events.get(kind, 0)
            for group_events in events
            for kind in ("charge_wraps", "current_wraps")
        ),
        "currents that lose a fraction in this recording; it keeps fractions": count(
            lambda core: _loses_fraction(core, played)
        ),
    }
    return [f"{reason} ({number})" for reason, number in count_by_reason.items() if number]


def updates(core: Core, played: Played) -> int:
    """Count the updates of a core as SANA-FE does, over all compartments and steps.

    It updates a compartment with a voltage, a bias or arriving spikes, even if the weights of these cancel.
    """
    # A compartment that spiked has a voltage in the next step, see AFTER_SPIKE.
    has_voltage = (played.register(core, "v") != 0) | (played.spikes(core) != 0)
    # Recorded registers are those after a step, so the voltage of the step before counts.
    had_voltage = np.concatenate((np.zeros_like(has_voltage[:1]), has_voltage[:-1]))
    return int((had_voltage | (core.bias != 0) | _arrives(core, played)).sum())


def _loses_fraction(core: Core, played: Played) -> BoolArray:
    """Mark the steps and compartments in which the decay of u leaves a fraction, (steps - 1, compartments)."""
    # u after the last step does not decay any more.
    u = played.register(core, "u")[:-1]
    return loihi_bounds.has_fraction(u, core.setting("decay_u"))


def _arrives(core: Core, played: Played) -> BoolArray:
    """Mark the steps and compartments in which at least one synapse delivers its weight, (steps, compartments)."""
    axons = core.axons
    spikes = played.axons(core)
    arrives = np.zeros((len(spikes), core.compartments), dtype=np.bool_)
    # All spikes over synapses of one delay arrive the same number of steps later.
    for delay in np.unique(axons.delay).tolist():
        has_delay = axons.delay == delay
        axon = axons.axon_of_synapse[has_delay]
        target = axons.target[has_delay]
        synapses = sparse.csr_array(
            (np.ones_like(axon), (axon, target)), shape=(axons.input_axons, core.compartments)
        )
        is_sent = (sparse.csr_array(spikes, dtype=np.int64) @ synapses).toarray() > 0
        steps_later = loihi.acts_at(0, delay)
        # What would arrive after the last step is left out.
        arrives[steps_later:] |= is_sent[: max(len(spikes) - steps_later, 0)]
    return arrives
