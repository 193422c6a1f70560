"""Every level as stable text, by the name that ``--emit`` takes."""

from __future__ import annotations

from collections.abc import Callable

from hw_model.level_text import array_text, compartments_text, placed_text, program_text, routed_text
from locsnn_compile.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.quantized import QuantizedNetwork


def network_text(network: Network) -> str:
    """Return the text of a Network."""
    seconds = "" if network.step_seconds is None else f" of {network.step_seconds:g} s"
    lines = [f"network {network.name}: {network.channels} channels, {network.steps} steps{seconds}"]
    for view in network.views:
        walk = "" if view.walk is None else f", walk {array_text(view.walk)}"
        lines.append(
            f"  input {view.name}: {view.lines} lines over {network.steps_of(view.axis)} {view.axis} steps{walk}"
        )
    for p in network.populations:
        n = p.neuron
        lines.append(
            f"  population {p.name}: {p.size} SRM neurons along {p.axis}, theta {n.theta:g}, tau_sr {n.tau_sr:g}, "
            f"tau_ref {n.tau_ref:g}, scale_ref {n.scale_ref:g}"
        )
    for projection in network.projections:
        lines.append(f"  weights {projection.source} -> {projection.target}: {array_text(projection.weights)}")
    return "\n".join(lines) + "\n"


def quantized_text(quantized: QuantizedNetwork) -> str:
    """Return the text of a QuantizedNetwork."""
    lines = [f"quantized {quantized.network.name}"]
    for q in quantized.populations:
        lines.append(
            f"  population {q.population.name}: scale {q.scale:g}, threshold {q.threshold}, decay {q.decay}, "
            f"refractory decay {q.refractory_decay}, refractory weight {q.refractory_mantissa} * "
            f"2^{q.refractory_exponent}, kernel error {q.kernel_error:.3g}"
        )
    for p in quantized.projections:
        lines.append(
            f"  weights {p.source} -> {p.target}: {p.weight_bits}-bit, exponent {p.exponent}, "
            f"mantissa {array_text(p.mantissa)}"
        )
    return "\n".join(lines) + "\n"


LEVEL_TEXTS: dict[str, Callable[[Levels], str]] = {
    "network": lambda levels: network_text(levels.network),
    "quantized": lambda levels: quantized_text(levels.quantized),
    "compartments": lambda levels: compartments_text(levels.compartments),
    "placed": lambda levels: placed_text(levels.placed),
    "routed": lambda levels: routed_text(levels.routed),
    "program": lambda levels: program_text(levels.program),
}
"""What ``--emit KIND`` writes to ``KIND.txt``."""
