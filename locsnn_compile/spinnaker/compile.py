"""Compile a network for SpiNNaker, and check it against the float reference."""

from dataclasses import replace

from hw_model.arithmetic import loihi
from hw_model.mapping.graph import CompartmentGraph, Readout
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.spinnaker.program import SpinnakerProgram
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.own_arithmetic.program_entries import program_entries
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize_by
from locsnn_compile.passes.rounding.task import FINE
from locsnn_compile.reference.evaluate import calibrate
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.request.compile_request import CompileRequest, check_only_setting
from locsnn_compile.request.recordings import calibration_for, recordings_for, with_psi
from locsnn_compile.spinnaker.comparison import compare_spinnaker
from locsnn_compile.spinnaker.compiled import CompiledSpinnaker
from locsnn_compile.spinnaker.document import spinnaker_figures
from locsnn_compile.spinnaker.fits import check_neurons
from locsnn_compile.spinnaker.grid import grid_of
from locsnn_compile.spinnaker.lower import LoweredSpinnaker, lower_to_spinnaker
from locsnn_compile.spinnaker.setting import SPINNAKER_SETTING


def fulfil_for_spinnaker(request: CompileRequest[SpinnakerChip]) -> CompiledSpinnaker:
    """Compile a network as requested, and check it against the float reference.

    Raises ``TargetError`` if the network needs something that SpiNNaker does not have. Raises ``InputError`` for
    recordings that do not fit, and for options that have a meaning for other chips only.
    """
    chip = request.chip
    _check_options(request)
    network = with_psi(request.network, request.check.psi)
    recordings = recordings_for(network, request.check.events, request.check.labels)
    network = network.with_steps_of(recordings)
    # After `with_steps_of`, since recordings that are made up for the calibration get the network's steps.
    calibration = calibration_for(network, recordings, request.setting.calibration)
    # First what can be refused quickly: recordings that do not fit, and neurons that SpiNNaker does not have.
    fitted = network.fitted(recordings)
    check_neurons(network)
    quantized = quantize_for(chip, network, calibration)
    graph = lower_neurons(quantized, grid_of(chip))
    lowered = lower_to_spinnaker(graph, chip)
    program = program_of(quantized, graph, lowered, chip)
    match = compare_spinnaker(quantized, program, fitted, request.check.progress)
    grounds = grounds_of(
        network,
        recordings,
        calibration,
        grid_of(chip).registers,
        rounded=quantized.populations,
    )
    figures = spinnaker_figures(quantized, lowered, program, match, grounds)
    return CompiledSpinnaker(
        quantized=quantized,
        lowered=lowered,
        program=program,
        match=match,
        figures=figures,
    )


def _check_options(request: CompileRequest[SpinnakerChip]) -> None:
    """Raise InputError for options that have no meaning for SpiNNaker."""
    name = request.chip.name
    check_only_setting(request, f"no table of the energies of {name} was checked")


def quantize_for(
    chip: SpinnakerChip, network: Network, calibration: Recordings
) -> QuantizedNetwork:
    """Round a network to the integers of ``loihi-sim``, with a single compartment per neuron.

    The calibration recordings are played to the float network, to see how large its potentials get.
    """
    grid = grid_of(chip)
    calibrated = calibrate(network, network.fitted(calibration), grid.registers)
    return quantize_by(network, grid, SPINNAKER_SETTING.setting, FINE, calibrated)


def program_of(
    quantized: QuantizedNetwork,
    graph: CompartmentGraph,
    lowered: LoweredSpinnaker,
    chip: SpinnakerChip,
) -> SpinnakerProgram:
    """Return the program, with the names, classes and recording properties of its network."""
    network = quantized.network
    return SpinnakerProgram(
        chip=chip,
        network=lowered.network,
        readout=readout_in_units(quantized.readout),
        provenance=graph.provenance,
        **program_entries(network),
    )


def readout_in_units(readout: Readout) -> Readout:
    """Return a readout for potentials in units of the integers, from one for the register v of ``loihi``.

    The register has more bits than the units, so weights of potentials are multiplied; spike counts stay.
    """
    weights = []
    for name, weight in readout.terms:
        is_read_by_potential = name in readout.from_step
        weights.append(float(loihi.in_registers(weight)) if is_read_by_potential else weight)
    return replace(readout, weights=tuple(weights))
