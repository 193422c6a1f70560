"""Count what simulated recordings did on the chip, and multiply the counts by costs: energy and latency."""
