"""The open core on test benches: what it is loaded with, its cycles, and programs played on it."""
