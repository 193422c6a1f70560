"""What a program can be written out as for other tools: test benches, waveform viewers, graphs, simulators.

:func:`locsnn_compile.backends.files.bench_files` gives the files; a kind a module.
"""

BENCH_KINDS = ("vectors", "vcd", "trace", "sanafe", "graphml", "dot")
"""What ``--emit`` takes beside the levels of the compiler."""
