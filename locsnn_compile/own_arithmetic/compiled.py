"""What compiling for a chip with an arithmetic of its own gives, as far as all families have it."""

from dataclasses import field, replace
from typing import Any, Self

from hw_model.targets.programs import AnyProgram
from hw_model.values import Frozen
from locsnn_compile.compiled import Compiled
from locsnn_compile.own_arithmetic.comparison import ProgramMatch
from locsnn_compile.report.figures.document import GateFigures, SharedFigures


class CompiledProgram(Compiled, Frozen, eq=False, repr=False):
    """A program and its check; ``figures`` are the content of report.json, with types.

    A family gives each of the three the type that it has there.
    """

    program: AnyProgram
    match: ProgramMatch[Any]
    figures: SharedFigures
    choice: None = field(default=None, kw_only=True)
    """There is nothing to choose: a family has one setting."""

    @property
    def chip_name(self) -> str:
        """The name of the chip."""
        return self.program.chip.name

    def with_gates(self, gates: tuple[GateFigures, ...]) -> Self:
        """Return the same with these gates in the report."""
        return replace(self, figures=self.figures.with_gates(gates))
