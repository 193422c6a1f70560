"""The result of compiling for a Xylo: a program, its network, and the report of their comparison."""

from collections.abc import Sequence
from functools import cached_property

from hw_model.xylo.files import xylo_files
from hw_model.xylo.program import XyloProgram
from locsnn_compile.backends.xylo.folder import xylo_folder
from locsnn_compile.emitters import Files, ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.own_arithmetic.compiled import CompiledProgram
from locsnn_compile.own_arithmetic.emitted import (
    EmittedKinds,
    network_file,
    recording_to_show,
    text_file,
)
from locsnn_compile.report.content import Report
from locsnn_compile.xylo.comparison import XyloMatch
from locsnn_compile.xylo.document import XyloFigures
from locsnn_compile.xylo.page import compose_xylo
from locsnn_compile.xylo.quantized import QuantizedXylo
from locsnn_compile.xylo.text import program_text


class CompiledXylo(CompiledProgram, eq=False, repr=False):
    """A program for a Xylo and its check; ``figures`` is the content of report.json, with types."""

    quantized: QuantizedXylo
    program: XyloProgram
    match: XyloMatch
    figures: XyloFigures

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose_xylo(self.figures)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.parts.network

    def program_files(self) -> Files:
        """Return ``program.yaml`` and ``program.npz``."""
        return xylo_files(self.program)

    def emitted_files(self, kinds: Sequence[str], shown: ShownRecording | None) -> Files:
        """Return the files of the given kinds of ``--emit``; ``xylo`` needs the recording ``shown``."""
        return XYLO_KINDS.files(self, self.program.chip, kinds, shown)


def _program_text(compiled: CompiledXylo, shown: ShownRecording | None) -> Files:
    return text_file("program.txt", program_text(compiled.program))


def _rockpool(compiled: CompiledXylo, shown: ShownRecording | None) -> Files:
    return xylo_folder(compiled.program, recording_to_show(compiled.network, shown))


XYLO_KINDS = EmittedKinds(
    writers={"network": network_file, "program": _program_text, "xylo": _rockpool},
    lacking="compartments, cores or a board",
)
"""The kinds of ``--emit`` that can be written for a Xylo."""
