"""What compiling for SpiNNaker gives: a program, its network, and the report of their comparison."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.errors import InputError, listed
from hw_model.io.build_folder import write_build
from hw_model.io.given import checked
from hw_model.spinnaker.files import spinnaker_files
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import Frozen
from locsnn_compile.backends.pynn.folder import pynn_folder
from locsnn_compile.emitters import ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.network.text import network_text, quantized_text
from locsnn_compile.report.content import Report
from locsnn_compile.report.figures.document import GateFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import render_html, render_summary
from locsnn_compile.report.sections.verdict import matches
from locsnn_compile.report.written import report_files
from locsnn_compile.spinnaker.comparison import SpinnakerMatch
from locsnn_compile.spinnaker.document import SpinnakerFigures
from locsnn_compile.spinnaker.lower import LoweredSpinnaker
from locsnn_compile.spinnaker.page import compose_spinnaker
from locsnn_compile.spinnaker.text import program_text


class CompiledSpinnaker(Frozen, eq=False):
    """A program for SpiNNaker and its check; ``figures`` are the content of report.json, with types."""

    quantized: QuantizedNetwork
    lowered: LoweredSpinnaker
    program: SpinnakerProgram
    match: SpinnakerMatch
    figures: SpinnakerFigures

    def __repr__(self) -> str:
        sentence = matches(self.figures).sentence.rstrip(".")
        name = self.network.name[:60]
        return f"<CompiledSpinnaker {name!r} on {self.program.chip.name}: {sentence}>"

    def _repr_html_(self) -> str:
        return render_summary(self.composed)

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json, as plain values."""
        return dict(plain(self.figures))

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose_spinnaker(self.figures)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.network

    def with_gates(self, gates: tuple[GateFigures, ...]) -> "CompiledSpinnaker":
        """Return the same with these gates in the report."""
        return replace(self, figures=replace(self.figures, gates=gates))

    def to_html(self) -> str:
        """Return report.html, a page in one file."""
        return render_html(self.composed)

    @property
    def choice(self) -> None:
        """There is nothing to choose: a neuron is one compartment, and weights have 8 bits."""
        return None

    def files(
        self, emit: Sequence[str] = (), shown: ShownRecording | None = None
    ) -> dict[str, bytes]:
        """Return the program and its reports as bytes, by name; equal input gives equal bytes.

        ``emit`` are kinds of ``--emit``; ``pynn`` needs the recording that is ``shown``.
        """
        check_emitted(self.program.chip.name, emit)
        files: dict[str, bytes] = spinnaker_files(self.program)
        files |= report_files(self.report, self.composed)
        for kind in EMITTED:
            if kind in emit:
                files |= EMITTED[kind](self, shown)
        return files

    @checked
    def save(self, folder: str | Path) -> None:
        """Write the program and its reports into a folder, or none of them; other files stay."""
        write_build(Path(folder), self.files())


Emit = Callable[[CompiledSpinnaker, ShownRecording | None], dict[str, bytes]]


def _network_text(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> dict[str, bytes]:
    text = network_text(compiled.network)
    return {"network.txt": text.encode(errors="backslashreplace")}


def _quantized_text(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> dict[str, bytes]:
    text = quantized_text(compiled.quantized)
    return {"quantized.txt": text.encode(errors="backslashreplace")}


def _program_text(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> dict[str, bytes]:
    text = program_text(compiled.program)
    return {"program.txt": text.encode(errors="backslashreplace")}


def _pynn(compiled: CompiledSpinnaker, shown: ShownRecording | None) -> dict[str, bytes]:
    if shown is None:
        raise InputError("emit", "it shows a recording, and none is given", fix="Give one.")
    (recording,) = compiled.network.fit(np.asarray(shown.spikes)[None], shown.title)
    return pynn_folder(compiled.program, recording)


EMITTED: dict[str, Emit] = {
    "network": _network_text,
    "quantized": _quantized_text,
    "program": _program_text,
    "pynn": _pynn,
}
"""The kinds of ``--emit`` that show what a program for SpiNNaker has, and their files by name."""


def check_emitted(chip: str, kinds: Sequence[str]) -> None:
    """Refuse kinds of ``--emit`` that show what SpiNNaker does not have."""
    for kind in kinds:
        if kind not in EMITTED:
            what = f"it shows compartments, cores of a mesh or a board, and {chip} has none of them"
            known = listed([f"--emit {name}" for name in EMITTED], "or")
            raise InputError(f"--emit {kind}", what, fix=f"Use {known}.")
