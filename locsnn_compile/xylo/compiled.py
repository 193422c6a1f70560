"""What compiling for a Xylo gives: a program, its network, and the report of their comparison."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from hw_model.errors import InputError, listed
from hw_model.values import Frozen
from hw_model.xylo.chips import XyloChip
from hw_model.xylo.files import xylo_files
from hw_model.xylo.program import XyloProgram
from locsnn_compile.backends.xylo.folder import xylo_folder
from locsnn_compile.compiled import Compiled
from locsnn_compile.emitters import Files, ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.network.text import network_text
from locsnn_compile.report.content import Report
from locsnn_compile.report.figures.document import GateFigures
from locsnn_compile.xylo.comparison import XyloMatch
from locsnn_compile.xylo.document import XyloFigures
from locsnn_compile.xylo.page import compose_xylo
from locsnn_compile.xylo.quantized import QuantizedXylo
from locsnn_compile.xylo.text import program_text


class CompiledXylo(Compiled, Frozen, eq=False, repr=False):
    """A program for a Xylo and its check; ``figures`` are the content of report.json, with types."""

    quantized: QuantizedXylo
    program: XyloProgram
    match: XyloMatch
    figures: XyloFigures
    choice: None = None
    """There is nothing to choose: neurons leak as the chip's do, and weights have 8 bits."""

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose_xylo(self.figures)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.parts.network

    def with_gates(self, gates: tuple[GateFigures, ...]) -> "CompiledXylo":
        """Return the same with these gates in the report."""
        return replace(self, figures=replace(self.figures, gates=gates))

    @property
    def chip_name(self) -> str:
        """The name of the chip."""
        return self.program.chip.name

    def program_files(self) -> Files:
        """Return ``program.yaml`` and ``program.npz``."""
        return xylo_files(self.program)

    def emitted_files(self, kinds: Sequence[str], shown: ShownRecording | None) -> Files:
        """Return the files of some kinds of ``--emit``; ``xylo`` needs the recording that is shown."""
        check_emitted(self.program.chip, kinds)
        files: Files = {}
        for kind, write in EMITTED.items():
            if kind in kinds:
                files |= write(self, shown)
        return files


def _network_text(compiled: CompiledXylo, shown: ShownRecording | None) -> dict[str, bytes]:
    text = network_text(compiled.network)
    return {"network.txt": text.encode(errors="backslashreplace")}


def _program_text(compiled: CompiledXylo, shown: ShownRecording | None) -> dict[str, bytes]:
    text = program_text(compiled.program)
    return {"program.txt": text.encode(errors="backslashreplace")}


def _rockpool(compiled: CompiledXylo, shown: ShownRecording | None) -> dict[str, bytes]:
    if shown is None:
        raise InputError("emit", "it shows a recording, and none is given", fix="Give one.")
    (recording,) = compiled.network.fit(np.asarray(shown.spikes)[None], shown.title)
    return xylo_folder(compiled.program, recording)


EMITTED: dict[str, Callable[[CompiledXylo, ShownRecording | None], Files]] = {
    "network": _network_text,
    "program": _program_text,
    "xylo": _rockpool,
}
"""The kinds of ``--emit`` that show what a program for a Xylo has, and their files by name."""


def check_emitted(chip: XyloChip, kinds: Sequence[str]) -> None:
    """Refuse kinds of ``--emit`` that show what a Xylo does not have."""
    for kind in kinds:
        if kind not in EMITTED:
            what = f"it shows compartments, cores or a board, and {chip.name} has none of them"
            known = listed([f"--emit {name}" for name in EMITTED], "or")
            raise InputError(f"--emit {kind}", what, fix=f"Use {known}.")
