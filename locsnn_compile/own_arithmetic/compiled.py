"""The result of compiling for a chip with an arithmetic of its own, as far as all families share it."""

from dataclasses import field, replace
from typing import Any, Self

from hw_model.targets.programs import AnyProgram
from hw_model.values import Frozen
from locsnn_compile.compiled import Compiled
from locsnn_compile.own_arithmetic.comparison import ProgramMatch
from locsnn_compile.report.figures.document import GateFigures, SharedFigures


class CompiledProgram(Compiled, Frozen, eq=False, repr=False):
    """A program, its check against the network, and the figures: the content of report.json, with types.

    The class of each family declares these three fields with the family's own types.
    """

    program: AnyProgram
    match: ProgramMatch[Any]
    figures: SharedFigures
    choice: None = field(default=None, kw_only=True)
    """Always None: a family has only one setting, so the compiler chooses none."""

    @property
    def chip_name(self) -> str:
        """The name of the chip."""
        return self.program.chip.name

    def with_gates(self, gates: tuple[GateFigures, ...]) -> Self:
        """Return a copy with these gates (limits that figures must meet) in the report."""
        return replace(self, figures=self.figures.with_gates(gates))
