"""What a program can be written out as for other tools: test benches, waveform viewers, graphs, simulators."""
