"""What a simulation counts: only integers, so that energy and latency only need to multiply.

A *phase* is a part of the time of a recording on the chip, with steps of its own. The first phases play events as they
come. A *location phase* follows: its neurons step over the channels of the recording, which a memory of the chip, the
transpose buffer, has kept for it.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields

from hw_model.values import Sums


class Counts(Sums, Mapping[str, int]):
    """Integer totals of one recording, or of several added up.

    A frozen dataclass, as all subclasses of ``Sums`` are; ``+`` adds two of them field by field. Read a count as
    ``counts.spikes`` or ``counts["spikes"]``: it is also a mapping from the name of each count to its value, which
    lists the fields first, then the properties below, which are derived from them.
    """

    input_events: int = 0
    """Events played to the phases as they come."""
    transpose_events: int = 0
    """Events that went through the transpose buffer to a location phase."""
    events_dropped: int = 0
    """Events after the last simulated step, which are never played. An event that several phases would have
    played counts once for each of them."""
    synaptic_ops: int = 0
    """Weights added: one for every synapse of every delivered spike, including those of the last step."""
    synaptic_ops_after_end: int = 0
    """Synaptic operations whose charge was due after the last step, so it had no effect."""
    neuron_updates: int = 0
    """Updates of compartments, dendrites included: compartments times steps of their phase."""
    neuron_updates_active: int = 0
    """Updates with anything other than 0 to work on: a charge, current, voltage or bias, or the voltage of a
    dendrite, which its parent compartment adds in the same step."""
    spikes: int = 0
    """Spikes of compartments, not counting input events."""
    axon_packets: int = 0
    """Packets sent by compartments: one for each spike and destination core."""
    packets_within_tile: int = 0
    """Packets of compartments whose destination is in the sender's tile."""
    input_packets: int = 0
    """Packets that bring input events to cores; they come from outside, so their hops are not counted."""
    hops_x: int = 0
    """Mesh hops east or west by packets of compartments."""
    hops_y: int = 0
    """Mesh hops north or south."""
    charge_wraps: int = 0
    """Compartment updates in which q left its 21 bits plus sign."""
    current_wraps: int = 0
    """Compartment updates in which u, or u + bias, left 23 bits plus sign (each counted)."""
    voltage_clips: int = 0
    """Compartment updates in which v was clipped to [vmin, vmax]."""
    skipped_steps: int = 0
    """Steps that an engine skipped because they could not change anything; the reference engine skips none."""
    aligned_steps: int = 0
    """Steps of recordings before their first touch, summed over the phases that begin only there."""
    cycles: int = 0
    """Clock cycles of the open core (our own RTL), from the first word of a recording that it accepts to its
    answer, the predicted class; 0 if it did not run."""

    @property
    def neuron_updates_inactive(self) -> int:
        """Updates of compartments at rest."""
        return self.neuron_updates - self.neuron_updates_active

    @property
    def hops(self) -> int:
        """All mesh hops."""
        return self.hops_x + self.hops_y

    @property
    def wraps(self) -> int:
        """All wraps, of charge and of current."""
        return self.charge_wraps + self.current_wraps

    @property
    def clips(self) -> int:
        """All clips."""
        return self.voltage_clips

    def __iter__(self) -> Iterator[str]:
        return iter((*COUNTED, *DERIVED))

    def __len__(self) -> int:
        return len(COUNT_NAMES)

    def __getitem__(self, name: str) -> int:
        if name not in COUNT_NAMES:
            raise KeyError(name)
        value: int = getattr(self, name)
        return value


COUNTED = tuple(field.name for field in fields(Counts))
"""The counts that are kept, in order; the others are derived from them."""
DERIVED = ("neuron_updates_inactive", "hops", "wraps", "clips")
COUNT_NAMES = frozenset(Counts())


def total(counts: Iterable[Counts]) -> Counts:
    """Add counts up."""
    return sum(counts, start=Counts())


BY_CORE = (
    "synaptic_ops", "neuron_updates", "neuron_updates_active", "spikes", "axon_packets", "packets_within_tile",
    "hops_x", "hops_y",
)  # fmt: skip
"""Counts that are kept by step and core. Synapses count at the receiving core, packets and hops at
the sending core."""
