"""The open core on test benches: its cycles, and what it did against the simulator."""
