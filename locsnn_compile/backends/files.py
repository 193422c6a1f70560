"""The files of every kind that ``--emit`` takes beside the levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import hw_model as hw
from hw_model.engine.playing import Spikes
from locsnn_compile.backends.graphs import dot_file, graphml_file
from locsnn_compile.backends.played import Played, play_recording
from locsnn_compile.backends.sanafe.files import sanafe_files
from locsnn_compile.backends.timeline import trace_file
from locsnn_compile.backends.vectors.vectors import vectors_files
from locsnn_compile.backends.waves import vcd_file

_OF_RECORDING: dict[str, Callable[[Played, Sequence[str]], dict[str, bytes]]] = {
    "vectors": lambda played, _: vectors_files(played),
    "vcd": vcd_file,
    "trace": lambda played, _: trace_file(played),
    "sanafe": lambda played, _: sanafe_files(played),
}
_OF_PROGRAM: dict[str, Callable[[hw.ChipProgram], dict[str, bytes]]] = {"graphml": graphml_file, "dot": dot_file}


def bench_files(
    program: hw.ChipProgram,
    kinds: Sequence[str],
    spikes: Spikes,
    title: str = "recording 0",
    probes: Sequence[str] = (),
) -> dict[str, bytes]:
    """Return the files of some of :data:`locsnn_compile.backends.BENCH_KINDS` by name; the same input gives the same
    bytes.

    ``spikes``: the one recording that vectors, waveforms, timeline and spikes for SANA-FE are of, (steps, channels), or
    a mapping by stream; ``title`` says which it is. ``probes``: compartments of the waveforms, ``population[index]``.
    """
    files: dict[str, bytes] = {}
    of_recording = [kind for kind in _OF_RECORDING if kind in kinds]
    if of_recording:
        played = play_recording(program, spikes, title)
        for kind in of_recording:
            files |= _OF_RECORDING[kind](played, probes)
    for kind, made in _OF_PROGRAM.items():
        if kind in kinds:
            files |= made(program)
    return files
