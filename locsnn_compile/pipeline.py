"""The whole compiler as one column of passes."""

import logging
from collections.abc import Callable
from dataclasses import replace

import hw_model as hw
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.graph import CompartmentGraph
from hw_model.mapping.placement import PlacedGraph, place_cores
from hw_model.mapping.routing import RoutedGraph, route_axons
from hw_model.program.assemble import assemble
from hw_model.program.text import compartments_text, placed_text, program_text, routed_text
from hw_model.targets import target_of
from hw_model.values import Shown, picked
from locsnn_compile.data.recordings import EventTimes
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.network.text import network_text, quantized_text
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize_by
from locsnn_compile.passes.rounding.task import NEAREST, Rounding
from locsnn_compile.reference.evaluate import Calibration
from locsnn_compile.settings import Setting, weight_bits_of

_log = logging.getLogger("locsnn")


class Levels(Shown):
    """A network at every level, from float to program."""

    network: Network
    quantized: QuantizedNetwork
    compartments: CompartmentGraph
    placed: PlacedGraph
    routed: RoutedGraph
    program: hw.ChipProgram


def lower(
    network: Network,
    chip: hw.Chip,
    weight_bits: int | None,
    strategy: str = "dendrite",
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> Levels:
    """Lower by these values of the first dials, all others usual; see :func:`lower_by`."""
    setting = Setting(strategy, weight_bits_of(chip, weight_bits), rounding.split)
    return lower_by(network, chip, setting, rounding, calibration)


def lower_by(
    network: Network,
    chip: hw.Chip,
    setting: Setting,
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> Levels:
    """Lower a network to a program by a setting; every level is checked."""
    check_network(network)
    quantized = quantize_by(network, chip, setting, rounding, calibration)
    compartments = lower_neurons(quantized, chip)
    placed = arrange_cores(place_cores(compartments, chip))
    routed = route_axons(placed)
    # What commands that play the program need to know of its network, and no core.
    of_network = picked(network, "step_seconds", "event_threshold", "psi", "class_names")
    of_network |= vars(network.event_times or EventTimes())
    program = replace(assemble(routed), **of_network, **network.numbering_entries)
    target_of(chip).check_fits(program, network.steps)
    _log.debug(
        "%s: %s, %d cores of %s", network.name, quantized.strategy, len(program.cores), chip.name
    )
    return Levels(network, quantized, compartments, placed, routed, program)


LEVEL_TEXTS: dict[str, Callable[[Levels], str]] = {
    "network": lambda levels: network_text(levels.network),
    "quantized": lambda levels: quantized_text(levels.quantized),
    "compartments": lambda levels: compartments_text(levels.compartments),
    "placed": lambda levels: placed_text(levels.placed),
    "routed": lambda levels: routed_text(levels.routed),
    "program": lambda levels: program_text(levels.program),
}
"""What ``--emit KIND`` writes to ``KIND.txt``: each level as stable text."""
