"""What every program of another arithmetic keeps of its network, next to what it plays."""

from typing import Any

from hw_model.values import picked
from locsnn_compile.data.recordings import EventTimes
from locsnn_compile.network.network import Network


def program_entries(network: Network) -> dict[str, Any]:
    """Return fields of a program by name: what is known of its recordings and classes."""
    known = picked(network, "name", "step_seconds", "event_threshold", "class_names")
    return known | vars(network.event_times or EventTimes()) | network.numbering_entries
