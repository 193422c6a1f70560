"""What every compiled network has, whatever the chip: a program, its check, and the report of both.

``compile`` returns a subclass for each family of chips: ``CompiledModel`` for meshes of cores and for the
open core (this project's own RTL, a single core), ``CompiledXylo`` and ``CompiledSpinnaker``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.arguments import checked
from hw_model.io.build_folder import write_build
from locsnn_compile.emitters import Files, ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.report.content import Report
from locsnn_compile.report.figures.document import GateFigures, SharedFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import render_html, render_summary
from locsnn_compile.report.sections.verdict import matches
from locsnn_compile.report.written import report_files
from locsnn_compile.request.choose_strategy import Choice

if TYPE_CHECKING:
    from hw_model.targets.programs import AnyProgram

NAME_CHARACTERS = 60
"""Characters of the network's name that ``repr`` shows, so that it stays about a line. Chosen by hand."""


class Compiled(ABC):
    """A program, the network that it came from, and the report of their comparison.

    - ``figures``: the content of report.json, with types
    - ``choice``: the settings that ``auto`` compared; None if there was nothing to choose
    - ``program``: the program for the chip
    """

    figures: SharedFigures
    choice: Choice | None

    # Only for the type checker: some subclasses are dataclasses with a field of this name, and would
    # take the property for the default of the field.
    if TYPE_CHECKING:

        @property
        def program(self) -> "AnyProgram":
            """The program, of the kind that its chip plays."""

    @property
    @abstractmethod
    def network(self) -> Network:
        """The trained network."""

    @property
    @abstractmethod
    def chip_name(self) -> str:
        """The name of the chip."""

    @property
    @abstractmethod
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""

    @abstractmethod
    def with_gates(self, gates: tuple[GateFigures, ...]) -> "Compiled":
        """Return the same network with gates in its report: the bounds that a user asked for, and which are met."""

    @abstractmethod
    def program_files(self) -> Files:
        """Return ``program.yaml`` and ``program.npz``."""

    @abstractmethod
    def emitted_files(self, kinds: Sequence[str], shown: ShownRecording | None) -> Files:
        """Return the files of the given kinds of ``--emit``, by name.

        ``shown`` is the recording that those files show, if there is one.
        """

    def __repr__(self) -> str:
        # The sentence of the report's first verdict, "Does it match?".
        match_verdict = matches(self.figures)
        sentence = match_verdict.sentence.rstrip(".")
        # Names come from files and may be of any length.
        short_name = self.network.name[:NAME_CHARACTERS]
        return f"<{type(self).__name__} {short_name!r} on {self.chip_name}: {sentence}>"

    def _repr_html_(self) -> str:
        # Notebooks show this.
        return render_summary(self.composed)

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json, as plain values."""
        return dict(plain(self.figures))

    def to_html(self) -> str:
        """Return report.html, a page in one file."""
        return render_html(self.composed)

    def files(self, emit: Sequence[str] = (), shown: ShownRecording | None = None) -> Files:
        """Return the program and its reports as bytes, by name, as ``locsnn-compile`` writes them.

        ``emit`` lists kinds of ``--emit``; the files of some kinds show one recording, ``shown``. Equal
        inputs give equal bytes.
        """
        files = self.program_files() | report_files(self.report, self.composed)
        return files | self.emitted_files(emit, shown)

    @checked
    def save(self, folder: str | Path) -> None:
        """Write the program and its reports into a folder, all or none of them.

        Other files in the folder stay, including those that ``--emit`` wrote for an earlier build.
        """
        write_build(Path(folder), self.files())
