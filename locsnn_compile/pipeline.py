"""The whole compiler as one column of passes."""

from __future__ import annotations

from dataclasses import dataclass

import hw_model as hw
from hw_model.arrangement import arrange_cores
from hw_model.graph import CompartmentGraph
from hw_model.placement import PlacedGraph, place_cores
from hw_model.program import assemble
from hw_model.routing import RoutedGraph, route_axons
from locsnn_compile.calibration import Calibration
from locsnn_compile.check_network import check_network
from locsnn_compile.network import Network
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding import NEAREST, Rounding
from locsnn_compile.quantized import QuantizedNetwork


@dataclass(frozen=True, eq=False)
class Levels:
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
    weight_bits: int,
    strategy: str = "dendrite",
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> Levels:
    """Lower a network to a program, SRM neurons by a strategy; every pass checks the level that it gives."""
    check_network(network)
    quantized = quantize(network, chip, weight_bits, strategy, rounding, calibration)
    compartments = lower_neurons(quantized, chip)
    placed = arrange_cores(place_cores(compartments, chip))
    routed = route_axons(placed)
    program = assemble(routed)
    return Levels(network, quantized, compartments, placed, routed, program)
