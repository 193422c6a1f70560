"""The fields that programs of all families take from the network: its name, its classes, and how events become
steps."""

from typing import Any

from hw_model.values import picked
from locsnn_compile.data.recordings import EventTimes
from locsnn_compile.network.network import Network


def program_entries(network: Network) -> dict[str, Any]:
    """Return these fields of a program, by name; unknown ones are None."""
    entries = picked(network, "name", "step_seconds", "event_threshold", "class_names")
    event_times = network.event_times or EventTimes()
    return entries | vars(event_times) | network.numbering_entries
