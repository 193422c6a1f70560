"""Compile a network for a Xylo, and check it against the float reference."""

from hw_model.xylo.chips import XyloChip
from hw_model.xylo.program import NamedPart, XyloProgram
from locsnn_compile.own_arithmetic.program_entries import program_entries
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.request.compile_request import CompileRequest, check_only_setting
from locsnn_compile.request.recordings import recordings_for, with_psi
from locsnn_compile.settings import NATIVE, check_matters
from locsnn_compile.xylo.comparison import compare_xylo
from locsnn_compile.xylo.compiled import CompiledXylo
from locsnn_compile.xylo.document import xylo_figures
from locsnn_compile.xylo.parts import XyloParts, parts_of
from locsnn_compile.xylo.quantize import quantize_xylo
from locsnn_compile.xylo.quantized import QuantizedXylo
from locsnn_compile.xylo.trained import trained_integers


def fulfil_for_xylo(request: CompileRequest[XyloChip]) -> CompiledXylo:
    """Compile a network as requested, and check it against the float reference.

    Raises ``TargetError`` if the network needs something that the chip does not have. Raises ``InputError`` for
    recordings that do not fit, and for options that have a meaning for other chips only.
    """
    chip = request.chip
    _check_options(request)
    network = with_psi(request.network, request.check.psi)
    recordings = recordings_for(network, request.check.events, request.check.labels)
    network = network.with_steps_of(recordings)
    # First, so that recordings that do not fit are refused before the work begins.
    fitted = network.fitted(recordings)
    parts = parts_of(network, chip)
    quantized = trained_integers(parts) if parts.on_grid else quantize_xylo(parts)
    program = program_of(parts, quantized, chip)
    match = compare_xylo(quantized, program, fitted, request.check.progress)
    grounds = grounds_of(network, recordings, recordings, registers=None)
    figures = xylo_figures(quantized, program, match, grounds)
    return CompiledXylo(
        quantized=quantized,
        program=program,
        match=match,
        figures=figures,
    )


def _check_options(request: CompileRequest[XyloChip]) -> None:
    """Raise InputError for options that have no meaning for a Xylo."""
    check_only_setting(request, f"no energies of {request.chip.name} are published")
    if request.setting.calibration is not None:
        check_matters(request.network, {"calibration": "calibration"})


def program_of(parts: XyloParts, quantized: QuantizedXylo, chip: XyloChip) -> XyloProgram:
    """Return the program, with the names, classes and recording properties of its network."""
    network = parts.network
    return XyloProgram(
        chip=chip,
        network=quantized.network,
        hidden=tuple(NamedPart(population.name, population.size) for population in parts.hidden),
        readout=network.readout,
        steps=None if network.any_length else network.steps,
        provenance={
            "model": network.name,
            "model_sha256": network.sha256,
            "strategy": NATIVE,
        },
        **program_entries(network),
    )
