"""The whole compiler as one column of passes: from a float network to a program for a mesh or the open core.

Each pass takes a network at one level and returns it at the next, which is nearer to the chip.
"""

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
    """A network at every level, from float to program.

    - ``network``: neurons and float weights, as trained
    - ``quantized``: integers of the chip instead of floats
    - ``compartments``: the chip's units instead of neurons
    - ``placed``: every compartment has a core
    - ``routed``: every synapse has a place in a list of its core
    - ``program``: the tables of all cores, as the chip loads them
    """

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
    """Lower a network by a strategy, weight bits and the rounding's split; see :func:`lower_by`.

    All other dials of the setting have their usual values.
    """
    setting = Setting(strategy, weight_bits_of(chip, weight_bits), rounding.split)
    return lower_by(network, chip, setting, rounding, calibration)


def lower_by(
    network: Network,
    chip: hw.Chip,
    setting: Setting,
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> Levels:
    """Lower a network to a program by a setting; every level is checked.

    ``calibration`` is what the float network does on recordings, for which weights are rounded.
    """
    check_network(network)
    quantized = quantize_by(network, chip, setting, rounding, calibration)
    compartments = lower_neurons(quantized, chip)
    placed = arrange_cores(place_cores(compartments, chip))
    routed = route_axons(placed)
    # Commands that play the program read recordings as its network expects them. No core needs this.
    reading_entries = picked(network, "step_seconds", "event_threshold", "psi", "class_names")
    reading_entries |= vars(network.event_times or EventTimes())
    program = replace(assemble(routed), **reading_entries, **network.numbering_entries)
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
