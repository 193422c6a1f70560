"""The result of compiling for SpiNNaker: a program, its network, and the report of their comparison."""

from collections.abc import Sequence
from functools import cached_property

from hw_model.spinnaker.files import spinnaker_files
from hw_model.spinnaker.program import SpinnakerProgram
from locsnn_compile.backends.pynn.folder import pynn_folder
from locsnn_compile.emitters import Files, ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.network.text import quantized_text
from locsnn_compile.own_arithmetic.compiled import CompiledProgram
from locsnn_compile.own_arithmetic.emitted import (
    EmittedKinds,
    network_file,
    recording_to_show,
    text_file,
)
from locsnn_compile.report.content import Report
from locsnn_compile.spinnaker.comparison import SpinnakerMatch
from locsnn_compile.spinnaker.document import SpinnakerFigures
from locsnn_compile.spinnaker.lower import LoweredSpinnaker
from locsnn_compile.spinnaker.page import compose_spinnaker
from locsnn_compile.spinnaker.text import program_text


class CompiledSpinnaker(CompiledProgram, eq=False, repr=False):
    """A program for SpiNNaker and its check; ``figures`` is the content of report.json, with types."""

    quantized: QuantizedNetwork
    lowered: LoweredSpinnaker
    program: SpinnakerProgram
    match: SpinnakerMatch
    figures: SpinnakerFigures

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose_spinnaker(self.figures)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.network

    def program_files(self) -> Files:
        """Return ``program.yaml`` and ``program.npz``."""
        return spinnaker_files(self.program)

    def emitted_files(self, kinds: Sequence[str], shown: ShownRecording | None) -> Files:
        """Return the files of the given kinds of ``--emit``; ``pynn`` needs the recording ``shown``."""
        return SPINNAKER_KINDS.files(self, self.program.chip, kinds, shown)


def _quantized_text(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> Files:
    return text_file("quantized.txt", quantized_text(compiled.quantized))


def _program_text(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> Files:
    return text_file("program.txt", program_text(compiled.program))


def _pynn(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> Files:
    return pynn_folder(compiled.program, recording_to_show(compiled.network, shown))


SPINNAKER_KINDS = EmittedKinds(
    writers={
        "network": network_file,
        "quantized": _quantized_text,
        "program": _program_text,
        "pynn": _pynn,
    },
    lacking="compartments, cores of a mesh or a board",
)
"""The kinds of ``--emit`` that can be written for SpiNNaker."""
