"""From activity to counts, energy and latency."""
