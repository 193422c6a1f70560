"""The files of :data:`locsnn_compile.backends.BENCH_KINDS`."""

from collections.abc import Callable, Sequence
from functools import cache

import hw_model as hw
from hw_model.engine.playing import Spikes
from hw_model.rtl.folder import rtl_files
from locsnn_compile.backends import BENCH_KINDS
from locsnn_compile.backends.graphs import dot_file, graphml_file
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.sanafe.files import sanafe_files
from locsnn_compile.backends.timeline import trace_file
from locsnn_compile.backends.vectors.vectors import vectors_files
from locsnn_compile.backends.waves import vcd_file
from locsnn_compile.errors import InputError

OF_MESH = ("vectors", "trace", "sanafe")
"""Kinds that describe the cores of a mesh, their memories and their times."""


def check_kinds(chip: hw.Chip, kinds: Sequence[str]) -> None:
    """Refuse kinds that describe a mesh of cores where the chip is an open core."""
    for kind in OF_MESH if chip.open_core else ():
        if kind in kinds:
            what = f"it describes a mesh of cores, and {chip.name} is an open core"
            raise InputError(f"--emit {kind}", what, fix="Use --emit rtl.")


def bench_files(
    program: hw.ChipProgram,
    kinds: Sequence[str],
    spikes: Spikes,
    title: str = "recording 0",
    probes: Sequence[str] = (),
) -> dict[str, bytes]:
    """Return the files of some kinds by name; equal input gives equal bytes.

    ``spikes`` are the recording to play for vectors, waveforms, timeline and SANA-FE, (steps, channels) or a mapping by
    stream; ``title`` names it. ``probes`` are the compartments of the waveforms, as ``population[index]``.
    Raises ``InputError`` for vectors, timeline and SANA-FE of an open core.
    """
    check_kinds(program.chip, kinds)
    played = cache(lambda: play_recording(program, spikes, title))
    makers: dict[str, Callable[[], dict[str, bytes]]] = {
        "vectors": lambda: vectors_files(played()),
        "rtl": lambda: rtl_files(program, spikes),
        "vcd": lambda: vcd_file(played(), probes),
        "trace": lambda: trace_file(played()),
        "sanafe": lambda: sanafe_files(played()),
        "graphml": lambda: graphml_file(program),
        "dot": lambda: dot_file(program),
    }
    made = [makers[kind]() for kind in BENCH_KINDS if kind in kinds]
    return {name: content for files in made for name, content in files.items()}
