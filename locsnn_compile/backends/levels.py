"""``--emit network|quantized|compartments|placed|routed|program``: every level of the compiler as stable text."""

from __future__ import annotations

from collections.abc import Callable

from hw_model.program.text import compartments_text, placed_text, program_text, routed_text
from locsnn_compile.network.text import network_text, quantized_text
from locsnn_compile.pipeline import Levels

LEVEL_TEXTS: dict[str, Callable[[Levels], str]] = {
    "network": lambda levels: network_text(levels.network),
    "quantized": lambda levels: quantized_text(levels.quantized),
    "compartments": lambda levels: compartments_text(levels.compartments),
    "placed": lambda levels: placed_text(levels.placed),
    "routed": lambda levels: routed_text(levels.routed),
    "program": lambda levels: program_text(levels.program),
}
"""What ``--emit KIND`` writes to ``KIND.txt``."""
