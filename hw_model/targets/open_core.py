"""This project's own core, on the boards and in the cells that it was made for.

What knows its SystemVerilog is imported only when a program is for it.
"""

from collections.abc import Mapping, Sequence

from hw_model.accounting.activity import StepActivity
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage, measure
from hw_model.accounting.worst_case import WorstCase
from hw_model.description.chip import Chip
from hw_model.description.counts import Counts
from hw_model.description.open_core import MemoryUse, Sizes
from hw_model.description.profile import UNPRICED
from hw_model.program.chip_program import ChipProgram
from hw_model.targets.target import LimitUse, Target
from hw_model.values import ByteArray

_CHOSEN_BY_THE_CHIP = ("word", "one_port")
"""Parameters of the core that say how its memories are built, so that no program fills them."""


class OpenCoreTarget(Target):
    """One core with exact cycles, which hosts all that a program names cores."""

    called = "an open core"
    has_mesh = False
    times_cores = False
    advises_strategies = True

    @classmethod
    def describes(cls, chip: Chip) -> bool:
        """Tell whether a chip's file has the sizes of the core."""
        return chip.open_core is not None

    @property
    def sizes(self) -> Sizes:
        """The parameters of the core."""
        assert self.chip.open_core is not None  # `describes` looks at it
        return self.chip.open_core

    @property
    def joins(self) -> bool:
        """Whether the core has a sum of joined voltages."""
        return self.sizes.join > 0

    @property
    def timed(self) -> bool:
        """Cycles are exact."""
        return True

    @property
    def basis_of_times(self) -> str:
        """Cycles of a clock as placed or, in cells of a process, as analysed."""
        if self.chip.profiles:
            return "cycle-exact model of the RTL core at the analysed clock"
        return UNPRICED.basis

    @property
    def room(self) -> str:
        """The sizes of its memories; what is known of its costs comes after the last comma."""
        sizes = self.sizes
        return (
            f"a program may have {sizes.compartments} compartments, {sizes.axons} sources of "
            f"spikes, {sizes.synapses} synapses, {sizes.slots} slots; cycles are exact, "
        )

    def check_fits(self, program: ChipProgram, rows: int) -> None:
        """Refuse what the core does not have, or has too few of."""
        from hw_model.rtl.device import on_core

        on_core(program, rows, self.chip)

    def cores_used(self, program: ChipProgram) -> int:
        """Return the one core."""
        return 1

    def limits_used(self, program: ChipProgram, rows: int) -> dict[str, LimitUse]:
        """Return what is needed of each parameter of the core that a program fills."""
        from hw_model.rtl.device import on_core, uses

        needs = on_core(program, rows, self.chip).needs
        return {
            name: LimitUse(used, limit)
            for name, (used, limit) in uses(needs, self.sizes).items()
            if name not in _CHOSEN_BY_THE_CHIP
        }

    def memories_used(self, program: ChipProgram, rows: int) -> dict[str, MemoryUse]:
        """Return how full a program makes each memory of the core."""
        from hw_model.rtl.device import on_core
        from hw_model.rtl.memory_use import memory_uses

        return memory_uses(on_core(program, rows, self.chip))

    def measure(
        self,
        program: ChipProgram,
        recordings: ByteArray,
        activity: Mapping[str, Sequence[StepActivity]],
        spikes: Mapping[str, ByteArray],
    ) -> tuple[list[Latency], dict[str, PhaseUsage]]:
        """Return the exact times, cycle by cycle, and the use of the program's cores."""
        from hw_model.rtl.device import latencies

        _, usage = measure(program, activity, self.chip.costs)
        return latencies(program, recordings, spikes), usage

    def worst_case(self, program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
        """Return bounds on the exact cycles."""
        from hw_model.rtl.worst_case import worst_case_on_core

        return worst_case_on_core(program, rows, events_per_step)

    def memory_accesses(
        self, program: ChipProgram, rows: int, counts: Counts, recordings: int
    ) -> dict[str, dict[str, float]]:
        """Return the memory accesses that the counts of some recordings stand for, on average."""
        from hw_model.rtl.device import activity, on_core

        return activity(on_core(program, rows, self.chip), counts, recordings)
