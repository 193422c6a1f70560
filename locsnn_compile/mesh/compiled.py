"""A network compiled for a mesh of cores or the open core: its program, and the report of their comparison."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import hw_model as hw
from hw_model.program.write import program_files
from hw_model.values import Frozen
from locsnn_compile.compiled import Compiled
from locsnn_compile.emitters import Build, Files, ShownRecording, emitted_files
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Report
from locsnn_compile.report.figures.document import GateFigures, ReportFigures
from locsnn_compile.request.choose_strategy import Choice
from locsnn_compile.verification.excerpt import Excerpt
from locsnn_compile.verification.matching import Match
from locsnn_compile.verification.observation import Observed


class CompiledModel(Compiled, Frozen, eq=False, repr=False):
    """A program, the network it came from, and the report of their comparison."""

    observed: Observed
    """The recordings of the check, and what the program and the float network do on them."""
    match: Match
    """How well both agree, spike by spike."""
    figures: ReportFigures
    """The content of report.json, with types."""
    choice: Choice | None = None
    """What ``auto`` compared; None if the strategy was given, or there was nothing to choose."""
    excerpt: Excerpt | None = None
    """The part of a recording that the report shows; None without a diagnosis."""

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose(self.figures, self.excerpt)

    @property
    def levels(self) -> Levels:
        """The network at every level, from float to program."""
        return self.observed.levels

    @property
    def program(self) -> hw.ChipProgram:
        """The program for the chip."""
        return self.levels.program

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.levels.network

    @property
    def chip_name(self) -> str:
        """The name of the chip."""
        return self.program.chip.name

    def with_gates(self, gates: tuple[GateFigures, ...]) -> "CompiledModel":
        """Return the same network with gates in its report: the bounds that a user asked for, and which are met."""
        return replace(self, figures=self.figures.with_gates(gates))

    def program_files(self) -> Files:
        """Return ``program.yaml`` and ``program.npz``."""
        return program_files(self.program)

    def emitted_files(self, kinds: Sequence[str], shown: ShownRecording | None) -> Files:
        """Return the files of some kinds of ``--emit``."""
        return emitted_files(Build(self.program, self, shown), kinds)
