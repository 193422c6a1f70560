"""Files of a program for other tools: test benches, waveform viewers, graph tools, simulators.

:func:`locsnn_compile.backends.files.bench_files` makes them, with a module for each kind.
"""

LEVEL_KINDS = ("network", "quantized", "compartments", "placed", "routed", "program")
"""Levels of the compiler, as text."""
BENCH_KINDS = ("vectors", "rtl", "vcd", "trace", "sanafe", "graphml", "dot")
"""A program and a recording played to it, for test benches, viewers and other simulators."""
EXCHANGE_KINDS = ("nir", "net")
"""The model itself, as a file of another tool."""
EMITTED_NAMES = {
    **{kind: f"{kind}.txt" for kind in LEVEL_KINDS},
    "vectors": "vectors/",
    "rtl": "rtl/",
    "vcd": "waves.vcd",
    "trace": "trace.json",
    "sanafe": "sanafe/",
    "graphml": "program.graphml",
    "dot": "program.dot",
    **{kind: f"network.{kind}" for kind in EXCHANGE_KINDS},
    "csv": "csv/",
    "viewer": "viewer.html",
}
"""The file that each kind writes, or the folder if the name ends in a slash."""
EMIT_KINDS = tuple(EMITTED_NAMES)
"""All that ``--emit`` takes."""
BUILD_NAMES = ("program.yaml", "program.npz", "report.json", "report.md", "report.html")
"""What every build holds."""
