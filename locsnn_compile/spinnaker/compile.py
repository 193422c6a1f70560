"""Compile a network for SpiNNaker, and check it against the float reference."""

from dataclasses import replace

from hw_model.arithmetic import loihi
from hw_model.mapping.graph import CompartmentGraph, Readout
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import Frozen, picked
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize_by
from locsnn_compile.passes.rounding.task import FINE
from locsnn_compile.reference.evaluate import calibrate
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.request.spinnaker_setting import SETTING
from locsnn_compile.spinnaker.comparison import compare_spinnaker
from locsnn_compile.spinnaker.compiled import CompiledSpinnaker
from locsnn_compile.spinnaker.document import spinnaker_figures
from locsnn_compile.spinnaker.fits import check_neurons
from locsnn_compile.spinnaker.grid import grid_of
from locsnn_compile.spinnaker.lower import LoweredSpinnaker, lower_to_spinnaker
from locsnn_compile.verification.matching import Progress


class SpinnakerRequest(Frozen, eq=False):
    """A network, a chip, the recordings of the check, and those that weights are rounded for."""

    network: Network
    chip: SpinnakerChip
    recordings: Recordings
    calibration: Recordings
    progress: Progress | None = None


def compile_for_spinnaker(request: SpinnakerRequest) -> CompiledSpinnaker:
    """Return the program of a network and its check.

    Raises ``TargetError`` for what SpiNNaker lacks, and ``InputError`` for recordings that do not
    fit.
    """
    recordings = request.recordings
    check_network(request.network)
    network = request.network.with_step_of(recordings)
    if network.any_length:
        network = replace(network, steps=recordings.spikes.shape[1])
    # Recordings that do not fit are refused before all the work.
    fitted = network.fitted(recordings)
    check_neurons(network)
    quantized = quantize_for(request.chip, network, request.calibration)
    graph = lower_neurons(quantized, grid_of(request.chip))
    lowered = lower_to_spinnaker(graph, request.chip)
    program = program_of(quantized, graph, lowered, request.chip)
    match = compare_spinnaker(quantized, program, fitted, request.progress)
    grounds = grounds_of(
        network,
        recordings,
        request.calibration,
        grid_of(request.chip).registers,
        rounded=quantized.populations,
    )
    figures = spinnaker_figures(quantized, lowered, program, match, grounds)
    return CompiledSpinnaker(quantized, lowered, program, match, figures)


def quantize_for(
    chip: SpinnakerChip, network: Network, calibration: Recordings
) -> QuantizedNetwork:
    """Round a network to the integers of single compartments."""
    grid = grid_of(chip)
    calibrated = calibrate(network, network.fitted(calibration), grid.registers)
    return quantize_by(network, grid, SETTING, FINE, calibrated)


def program_of(
    quantized: QuantizedNetwork,
    graph: CompartmentGraph,
    lowered: LoweredSpinnaker,
    chip: SpinnakerChip,
) -> SpinnakerProgram:
    """Return the program with all that is known of its network and recordings."""
    network = quantized.network
    known = picked(network, "name", "step_seconds", "event_threshold", "class_names")
    return SpinnakerProgram(
        chip=chip,
        network=lowered.network,
        readout=readout_in_units(quantized.readout),
        provenance=graph.provenance,
        **known,
        **network.numbering_entries,
    )


def readout_in_units(readout: Readout) -> Readout:
    """Return a readout of potentials of 1, from one of the register v of ``loihi``."""
    read = readout.from_step
    weights = [
        float(loihi.in_registers(weight)) if name in read else weight
        for name, weight in readout.terms
    ]
    return replace(readout, weights=tuple(weights))
