"""report.json: the figures, as plain values."""
