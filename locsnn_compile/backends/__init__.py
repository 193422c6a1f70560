"""Files of a program for other tools: test benches, waveform viewers, graph tools, simulators.

A module for each kind; :mod:`locsnn_compile.emitters` lists them.
"""
