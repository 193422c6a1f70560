"""From what happened to counts, energy and latency."""
