"""Targets that are the open core: this project's own core, on an FPGA or in the cells of a process.

One core hosts all cores of a program, phase after phase, so limits are about the program as a
whole. Modules that know the core's SystemVerilog (``hw_model/rtl``) are imported only where a
program is for it, as they take time to load.
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
"""Parameters of the core that say how its memories are built; no program fills them, so reports
leave them out."""


class OpenCoreTarget(Target):
    """The open core, which hosts all cores of a program. Its times are exact cycles."""

    called = "an open core"
    has_mesh = False
    times_cores = False
    advises_strategies = True

    @classmethod
    def describes(cls, chip: Chip) -> bool:
        """Return whether the description of a chip has the sizes of an open core."""
        return chip.open_core is not None

    @property
    def sizes(self) -> Sizes:
        """The parameters of the core."""
        # Otherwise the chip is not of this kind, see `describes`.
        assert self.chip.open_core is not None
        return self.chip.open_core

    @property
    def joins(self) -> bool:
        """Whether the core is built with sums of joined voltages."""
        return self.sizes.join > 0

    @property
    def timed(self) -> bool:
        """True: cycles are always known."""
        return True

    @property
    def basis_of_times(self) -> str:
        """What times rest on: exact cycles, of a clock from placement or, in cells, from analysis.

        Only a core in cells has energy profiles.
        """
        if self.chip.profiles:
            return "cycle-exact model of the RTL core at the analysed clock"
        return UNPRICED.basis

    @property
    def room(self) -> str:
        """The sizes of its memories, up to a comma, where :attr:`in_words` adds the costs."""
        sizes = self.sizes
        return (
            f"a program may have {sizes.compartments} compartments, {sizes.axons} sources of "
            f"spikes, {sizes.synapses} synapses, {sizes.slots} slots; cycles are exact, "
        )

    def check_fits(self, program: ChipProgram, rows: int) -> None:
        """Raise a ``TargetError`` if the core lacks, or has too few of, what a program needs."""
        from hw_model.rtl.device import on_core

        on_core(program, rows, self.chip)

    def cores_used(self, program: ChipProgram) -> int:
        """Return 1: one core hosts the program."""
        return 1

    def limits_used(self, program: ChipProgram, rows: int) -> dict[str, LimitUse]:
        """Return how much of each of the core's sizes a program needs."""
        from hw_model.rtl.device import on_core, uses

        needs = on_core(program, rows, self.chip).needs
        return {
            name: LimitUse(used, limit)
            for name, (used, limit) in uses(needs, self.sizes).items()
            if name not in _CHOSEN_BY_THE_CHIP
        }

    def memories_used(self, program: ChipProgram, rows: int) -> dict[str, MemoryUse]:
        """Return how full a program makes each memory of the core, by the memory's name."""
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
        """Return the exact time of each recording, and how much the program's cores are used."""
        from hw_model.rtl.device import latencies

        _, usage = measure(program, activity, self.chip.costs)
        return latencies(program, recordings, spikes), usage

    def worst_case(self, program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
        """Return bounds on the exact times."""
        from hw_model.rtl.worst_case import worst_case_on_core

        return worst_case_on_core(program, rows, events_per_step)

    def memory_accesses(
        self, program: ChipProgram, rows: int, counts: Counts, recordings: int
    ) -> dict[str, dict[str, float]]:
        """Return the mean memory accesses and multiplications of a recording, from counts."""
        from hw_model.rtl.device import activity, on_core

        return activity(on_core(program, rows, self.chip), counts, recordings)
