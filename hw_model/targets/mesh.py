"""Targets that are a mesh of cores, like Loihi, with times from a profile."""

from collections.abc import Mapping, Sequence

from hw_model.accounting.activity import StepActivity
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage, measure
from hw_model.accounting.worst_case import WorstCase, worst_case
from hw_model.description.chip import Chip
from hw_model.errors import counted
from hw_model.program.chip_program import ChipProgram
from hw_model.targets.target import LimitUse, Target
from hw_model.values import ByteArray


class MeshTarget(Target):
    """A mesh of cores.

    Mapping gives a program as many cores as it needs, and checks the limits of each. Times are
    counts of a simulation, priced by the chip's first profile.
    """

    called = "a mesh of cores"
    has_mesh = True
    times_cores = True
    advises_strategies = False

    @classmethod
    def describes(cls, chip: Chip) -> bool:
        """Return True: every chip that is of no other kind is a mesh, so this kind comes last."""
        return True

    @property
    def joins(self) -> bool:
        """Compartments of a core can be joined."""
        return True

    @property
    def timed(self) -> bool:
        """Whether the chip's first profile has times."""
        return bool(self.chip.costs.time_ns)

    @property
    def basis_of_times(self) -> str:
        """What times rest on, as the first profile says."""
        return self.chip.costs.basis

    @property
    def room(self) -> str:
        """The chips and cores of the board, and what a core holds."""
        limits = self.chip.limits
        chips = counted(self.chip.chips, "chip")
        cores = counted(limits.cores_per_chip, "core")
        return (
            f"{chips} of {cores}; a core holds {limits.compartments_per_core} compartments, "
            f"{limits.input_axons_per_core} input axons, "
            f"{limits.synapse_words_per_core} synapse words\n  "
        )

    def check_fits(self, program: ChipProgram, rows: int) -> None:
        """Refuse nothing, as mapping has checked the limits of every core."""

    def cores_used(self, program: ChipProgram) -> int:
        """Return the number of the program's cores."""
        return len(program.cores)

    def limits_used(self, program: ChipProgram, rows: int) -> dict[str, LimitUse]:
        """Return the number of cores and, for each limit of a core, the most that a core uses."""
        limits = self.chip.limits
        cores = program.cores
        most_compartments = max(core.compartments for core in cores)
        most_axons_in = max(core.axons.input_axons for core in cores)
        most_axons_out = max(core.axons.output_axons for core in cores)
        most_words = max(core.axons.synapse_words for core in cores)
        most_formats = max(len(core.axons.formats) for core in cores)
        most_profiles = max(len(core.profiles) for core in cores)
        most_thresholds = max(len(core.thresholds) for core in cores)
        return {
            "cores": LimitUse(len(cores), self.chip.cores),
            "compartments": LimitUse(most_compartments, limits.compartments_per_core),
            "axons_in": LimitUse(most_axons_in, limits.input_axons_per_core),
            "axons_out": LimitUse(most_axons_out, limits.output_axons_per_core),
            "synapse_words": LimitUse(most_words, limits.synapse_words_per_core),
            "synapse_formats": LimitUse(most_formats, limits.synapse_formats_per_core),
            "compartment_profiles": LimitUse(most_profiles, limits.compartment_profiles_per_core),
            "threshold_profiles": LimitUse(most_thresholds, limits.threshold_profiles_per_core),
        }

    def measure(
        self,
        program: ChipProgram,
        recordings: ByteArray,
        activity: Mapping[str, Sequence[StepActivity]],
        spikes: Mapping[str, ByteArray],
    ) -> tuple[list[Latency], dict[str, PhaseUsage]]:
        """Return the times by the chip's first profile, and the use of cores and links."""
        return measure(program, activity, self.chip.costs)

    def worst_case(self, program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
        """Return bounds by the chip's first profile."""
        return worst_case(program, rows, events_per_step)
