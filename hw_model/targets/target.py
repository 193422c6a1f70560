"""The questions that the compiler and the report ask about a target, whatever its kind."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

from hw_model.accounting.activity import StepActivity
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage
from hw_model.accounting.worst_case import WorstCase
from hw_model.description.chip import Chip
from hw_model.description.counts import Counts
from hw_model.description.open_core import MemoryUse
from hw_model.program.chip_program import ChipProgram
from hw_model.values import ByteArray, Frozen


class LimitUse(NamedTuple):
    """How much of a limit is used; of a core's limit, by the core that uses most."""

    used: int
    limit: int


class Target(Frozen, ABC):
    """A chip as a target of the compiler. Its subclasses are the kinds of targets.

    - ``called``: what messages call the kind, such as ``a mesh of cores``
    - ``has_mesh``: whether it has cores at places of a mesh, with memories and times of their own
    - ``times_cores``: whether its times are known step by step and core by core, and not only for
      whole recordings
    - ``advises_strategies``: whether, for a program that does not fit, other strategies are tried,
      so that the error can name one that fits
    """

    chip: Chip
    called: ClassVar[str]
    has_mesh: ClassVar[bool]
    times_cores: ClassVar[bool]
    advises_strategies: ClassVar[bool]

    @classmethod
    @abstractmethod
    def describes(cls, chip: Chip) -> bool:
        """Return whether a chip is of this kind."""

    @property
    @abstractmethod
    def joins(self) -> bool:
        """Whether a compartment can add the voltages of others to its own."""

    @property
    @abstractmethod
    def timed(self) -> bool:
        """Whether any times are known."""

    @property
    @abstractmethod
    def basis_of_times(self) -> str:
        """What times rest on, in words: a publication, a model, a measurement."""

    @property
    @abstractmethod
    def room(self) -> str:
        """What a program may have, in words; :attr:`in_words` appends what is known of its costs."""

    @property
    def in_words(self) -> str:
        """What a program may have, and what is known of costs, for ``locsnn targets``."""
        costs = "energy is not known"
        if self.chip.profiles:
            costs = f"energy profiles: {', '.join(self.chip.profiles)}"
        return f"{self.room}{costs}"

    @abstractmethod
    def check_fits(self, program: ChipProgram, rows: int) -> None:
        """Raise a ``TargetError`` if a program does not fit in a way that mapping does not check.

        ``rows``: the steps of the recordings that it is for.
        """

    @abstractmethod
    def cores_used(self, program: ChipProgram) -> int:
        """Return how many cores of the hardware a program takes."""

    @abstractmethod
    def limits_used(self, program: ChipProgram, rows: int) -> dict[str, LimitUse]:
        """Return how much a program uses of each limit, by the limit's name."""

    def memories_used(self, program: ChipProgram, rows: int) -> dict[str, MemoryUse]:
        """Return how full each memory is, by its name; empty if only limits are known."""
        return {}

    @abstractmethod
    def measure(
        self,
        program: ChipProgram,
        recordings: ByteArray,
        activity: Mapping[str, Sequence[StepActivity]],
        spikes: Mapping[str, ByteArray],
    ) -> tuple[list[Latency], dict[str, PhaseUsage]]:
        """Return the time of each recording of a batch, and the use of cores and links by phase.

        ``recordings`` are (batch, steps, channels); ``activity`` and ``spikes`` are those of their
        simulation.
        """

    @abstractmethod
    def worst_case(self, program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
        """Bound the time of recordings of ``rows`` steps with at most so many events per step."""

    def memory_accesses(
        self, program: ChipProgram, rows: int, counts: Counts, recordings: int
    ) -> dict[str, dict[str, float]] | None:
        """Return memory accesses and multiplications per recording; None if they are unknown.

        ``counts`` are totals of a number of ``recordings``.
        """
        return None
