"""Compile a network for a Xylo, and check it against the float reference."""

from dataclasses import replace

from hw_model.values import Frozen, picked
from hw_model.xylo.chips import XyloChip
from hw_model.xylo.program import NamedPart, XyloProgram
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import Network
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.settings import NATIVE
from locsnn_compile.verification.matching import Progress
from locsnn_compile.xylo.comparison import compare_xylo
from locsnn_compile.xylo.compiled import CompiledXylo
from locsnn_compile.xylo.document import xylo_figures
from locsnn_compile.xylo.parts import XyloParts, parts_of
from locsnn_compile.xylo.quantize import quantize_xylo
from locsnn_compile.xylo.quantized import QuantizedXylo
from locsnn_compile.xylo.trained import trained_integers


class XyloRequest(Frozen, eq=False):
    """A network, a chip, and the recordings of the check."""

    network: Network
    chip: XyloChip
    recordings: Recordings
    progress: Progress | None = None


def compile_for_xylo(request: XyloRequest) -> CompiledXylo:
    """Return the program of a network and its check.

    Raises ``TargetError`` for what the chip lacks, and ``InputError`` for recordings that do not
    fit.
    """
    recordings = request.recordings
    check_network(request.network)
    network = request.network.with_step_of(recordings)
    if network.any_length:
        network = replace(network, steps=recordings.spikes.shape[1])
    # Recordings that do not fit are refused before all the work.
    fitted = network.fitted(recordings)
    parts = parts_of(network, request.chip)
    quantized = trained_integers(parts) if parts.on_grid else quantize_xylo(parts)
    program = program_of(parts, quantized, request.chip)
    match = compare_xylo(quantized, program, fitted, request.progress)
    grounds = grounds_of(network, recordings, recordings, registers=None)
    return CompiledXylo(quantized, program, match, xylo_figures(quantized, program, match, grounds))


def program_of(parts: XyloParts, quantized: QuantizedXylo, chip: XyloChip) -> XyloProgram:
    """Return the program with all that is known of its network and recordings."""
    network = parts.network
    known = picked(network, "name", "step_seconds", "event_threshold", "class_names")
    return XyloProgram(
        chip=chip,
        network=quantized.network,
        hidden=tuple(NamedPart(each.name, each.size) for each in parts.hidden),
        readout=network.readout,
        steps=None if network.any_length else network.steps,
        provenance={
            "model": network.name,
            "model_sha256": network.sha256,
            "strategy": NATIVE,
        },
        **known,
        **network.numbering_entries,
    )
