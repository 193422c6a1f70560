"""What ``--emit KIND`` writes: a table with one row for each kind. To add an emitter, write its module and its row.

A row has a function that returns the files of its kind. The function imports the module that makes
them only when it is called, so that help and builds without this kind do not wait for the import; for
the same reason, the classes here are plain dataclasses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from locsnn_compile.errors import InputError, listed

if TYPE_CHECKING:
    import hw_model as hw
    from hw_model.engine.playing import Spikes
    from locsnn_compile.backends.played import Played
    from locsnn_compile.mesh.compiled import CompiledModel

LEVEL_KINDS = ("network", "quantized", "compartments", "placed", "routed", "program")
"""Levels of the compiler, from the trained network to the program."""
BUILD_NAMES = ("program.yaml", "program.npz", "report.json", "report.md", "report.html")
"""The files that every build holds, whatever it emits."""
Files = dict[str, bytes]
"""Contents by the name of their file below the folder of the build."""


@dataclass(frozen=True, eq=False)
class ShownRecording:
    """The recording that emitted files show.

    - ``spikes``: (steps, channels), or a mapping by input stream
    - ``title``: names the recording
    - ``probes``: the compartments that waveforms show, as ``population[index]``
    """

    spikes: "Spikes"
    title: str = "recording 0"
    probes: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Build:
    """All that an emitter may write about.

    ``compiled`` is None for a program that was written by hand, and ``shown`` is None if none of the
    kinds shows a recording.
    """

    program: "hw.ChipProgram"
    compiled: "CompiledModel | None" = None
    shown: ShownRecording | None = None

    @property
    def model(self) -> "CompiledModel":
        """The compiled model; ``InputError`` where the program was written by hand."""
        if self.compiled is None:
            what = "it shows a model, and the program was written by hand"
            raise InputError("emit", what, fix="Compile a model.")
        return self.compiled

    @property
    def recording(self) -> ShownRecording:
        """The recording to show; ``InputError`` where there is none."""
        if self.shown is None:
            raise InputError("emit", "it shows a recording, and none is given", fix="Give one.")
        return self.shown

    @cached_property
    def played(self) -> "Played":
        """The shown recording on the program: played once, however many kinds show it."""
        from locsnn_compile.backends.played import play_recording

        return play_recording(self.program, self.recording.spikes, self.recording.title)


class Writer(Protocol):
    """Returns the files of one kind. Equal builds give equal bytes."""

    def __call__(self, build: Build, /) -> Files:
        """Write about ``build``; ``InputError`` for what the format cannot hold."""


@dataclass(frozen=True)
class OtherChip:
    """A kind of chip with an arithmetic of its own, for messages: ``a Xylo``, such as ``xylo-audio3``."""

    called: str
    example: str


@dataclass(frozen=True)
class Emitter:
    """A kind of ``--emit``.

    - ``kind``: its name on the command line
    - ``path``: the file that it writes, or its folder if the name ends in a slash
    - ``write``: returns the contents by name
    - ``holds``: a regular expression for the names below its folder, including files that the tools
      of this kind leave there. A later build replaces such files, and refuses to remove any other
    - ``shows_recording``: it shows one recording, the one of ``--recording``
    - ``of_mesh``: it describes a mesh of cores, with their memories and times; the open core is none
    - ``of_chip``: it describes another kind of chip, whose compiled networks write it themselves
    """

    kind: str
    path: str
    write: Writer
    holds: str = ""
    shows_recording: bool = False
    of_mesh: bool = False
    of_chip: "OtherChip | None" = None


class LevelText:
    """Writes a level of the compiler as stable text."""

    def __init__(self, level: str) -> None:
        self.level = level

    def __call__(self, build: Build, /) -> Files:
        """Return ``LEVEL.txt``; characters in names that UTF-8 cannot encode, lone surrogates, are escaped."""
        from locsnn_compile.pipeline import LEVEL_TEXTS

        text = LEVEL_TEXTS[self.level](build.model.levels)
        return {f"{self.level}.txt": text.encode(errors="backslashreplace")}


def _vectors(build: Build) -> Files:
    from locsnn_compile.backends.vectors.vectors import vectors_files

    return vectors_files(build.played)


def _rtl(build: Build) -> Files:
    from hw_model.rtl.folder import rtl_files

    return rtl_files(build.program, build.recording.spikes)


def _vcd(build: Build) -> Files:
    from locsnn_compile.backends.waves import vcd_file

    return vcd_file(build.played, build.recording.probes)


def _trace(build: Build) -> Files:
    from locsnn_compile.backends.timeline import trace_file

    return trace_file(build.played)


def _sanafe(build: Build) -> Files:
    from locsnn_compile.backends.sanafe.files import sanafe_files

    return sanafe_files(build.played)


def _lava(build: Build) -> Files:
    from locsnn_compile.backends.lava.folder import lava_files

    return lava_files(build.played)


def _graphml(build: Build) -> Files:
    from locsnn_compile.backends.graphs import graphml_file

    return graphml_file(build.program)


def _dot(build: Build) -> Files:
    from locsnn_compile.backends.graphs import dot_file

    return dot_file(build.program)


def _nir(build: Build) -> Files:
    from locsnn_compile.backends.exchange import exchange_file

    return {"network.nir": exchange_file("nir", build.model.levels.quantized)}


def _net(build: Build) -> Files:
    from locsnn_compile.backends.exchange import exchange_file

    return {"network.net": exchange_file("net", build.model.levels.quantized)}


def _of_other_chip(build: Build) -> Files:
    # Compiled networks for Xylo and SpiNNaker do not come here, and check_kinds refuses all others.
    raise AssertionError(f"{build.program.chip.name} is another chip, which check_kinds has said")


def _events(build: Build) -> Files:
    from locsnn_compile.data.recordings import Recordings
    from locsnn_compile.data.write import npz_bytes

    compiled = build.model
    observed = compiled.observed
    step_seconds = compiled.network.stated_step_seconds
    recordings = Recordings(observed.recordings, observed.labels, step_seconds, observed.source)
    return {"events.npz": npz_bytes(recordings)}


def _csv(build: Build) -> Files:
    from locsnn_compile.report.renderers.csv_files import csv_files

    return csv_files(build.model.report, build.model.excerpt)


def _viewer(build: Build) -> Files:
    from locsnn_compile.report.viewer.page import render_viewer

    compiled = build.model
    first_divergence = compiled.match.first_divergence
    page = render_viewer(compiled.observed, compiled.figures, first_divergence)
    return {"viewer.html": page}


# Patterns of the names in the folders of emitters (``Emitter.holds``).
_VECTORS = r"README\.md|manifest\.yaml|core\d+/\w+\.hex"
_RTL = (
    r"[\w-]+\.(sv|v|ys|mk|vh|lpf|pcf|md)|[\w-]+\.(top\.sv|board\.mk)"
    r"|memories\.csv|Makefile|load|words|expected_\w+"
    # Files that `make` leaves there.
    r"|[\w-]+\.(bench|json|cells|log|config|asc|bit|bin|smt2|proved)|solver/boolector"
    r"|updates|scores|answers"
)
_SANAFE = r"README\.md|(arch|expected|time|location)\.yaml"
_SCRIPT = r"network\.py|network\.npz|expected\.npz"
_ROCKPOOL = r"specification\.npz|expected\.npz|run\.py"
_TABLES = r"(figures|spikes|potential)\.csv"
XYLO = OtherChip("a Xylo", "xylo-audio3")
SPINNAKER = OtherChip("a SpiNNaker", "spinnaker1")
EMITTERS = (
    *(Emitter(level, f"{level}.txt", LevelText(level)) for level in LEVEL_KINDS),
    Emitter("vectors", "vectors/", _vectors, _VECTORS, shows_recording=True, of_mesh=True),
    Emitter("rtl", "rtl/", _rtl, _RTL, shows_recording=True),
    Emitter("vcd", "waves.vcd", _vcd, shows_recording=True),
    Emitter("trace", "trace.json", _trace, shows_recording=True, of_mesh=True),
    Emitter("sanafe", "sanafe/", _sanafe, _SANAFE, shows_recording=True, of_mesh=True),
    Emitter("lava", "lava/", _lava, _SCRIPT, shows_recording=True),
    Emitter("graphml", "program.graphml", _graphml),
    Emitter("dot", "program.dot", _dot),
    Emitter("nir", "network.nir", _nir),
    Emitter("net", "network.net", _net),
    Emitter("xylo", "xylo/", _of_other_chip, _ROCKPOOL, shows_recording=True, of_chip=XYLO),
    Emitter("pynn", "spinnaker/", _of_other_chip, _SCRIPT, shows_recording=True, of_chip=SPINNAKER),
    Emitter("csv", "csv/", _csv, _TABLES),
    Emitter("events", "events.npz", _events),
    Emitter("viewer", "viewer.html", _viewer),
)
"""In the order of the help, which is the order in which files are listed."""
EMIT_KINDS = tuple(emitter.kind for emitter in EMITTERS)


# "rtl/" and its pattern become "rtl/(pattern)".
NAMES_IN_FOLDERS = "|".join(
    f"{emitter.path}({emitter.holds})" for emitter in EMITTERS if emitter.path.endswith("/")
)
"""A pattern of all names inside the folders of a build: a later build may replace them."""


def emitters_of(kinds: Sequence[str]) -> list[Emitter]:
    """Return the rows of some kinds, in the order of the table."""
    return [emitter for emitter in EMITTERS if emitter.kind in kinds]


def check_kinds(chip: "hw.Chip", kinds: Sequence[str]) -> None:
    """Refuse kinds for Xylo or SpiNNaker, and for the open core those that describe a mesh of cores."""
    for emitter in emitters_of(kinds):
        if emitter.of_chip is not None:
            what = f"it describes {emitter.of_chip.called}, and {chip.name} is none"
            fix = f"Compile for one, such as --target {emitter.of_chip.example}."
            raise InputError(f"--emit {emitter.kind}", what, fix=fix)
    mesh_emitters = [emitter for emitter in emitters_of(kinds) if emitter.of_mesh]
    if not mesh_emitters:
        return
    from hw_model.targets import target_of

    target = target_of(chip)
    for emitter in mesh_emitters:
        if not target.has_mesh:
            what = f"it describes a mesh of cores, and {chip.name} is {target.called}"
            raise InputError(f"--emit {emitter.kind}", what, fix="Use --emit rtl.")


def check_recording_is_shown(kinds: Sequence[str]) -> None:
    """Refuse ``--recording`` if none of the kinds shows a single recording."""
    if any(emitter.shows_recording for emitter in emitters_of(kinds)):
        return
    kinds_that_show = [emitter.kind for emitter in EMITTERS if emitter.shows_recording]
    fix = f"Add --emit {listed(kinds_that_show, 'or')}."
    raise InputError("--recording", "no emitted file shows a single recording", fix=fix)


def emitted_files(build: Build, kinds: Sequence[str]) -> Files:
    """Return the files of some kinds.

    Raises ``InputError`` for a kind that does not describe this chip, for one that shows a recording
    or a model if there is none, and for what a format cannot hold.
    """
    check_kinds(build.program.chip, kinds)
    files: Files = {}
    for emitter in emitters_of(kinds):
        files |= emitter.write(build)
    return files


def bench_files(
    program: "hw.ChipProgram",
    kinds: Sequence[str],
    spikes: "Spikes",
    title: str = "recording 0",
    probes: Sequence[str] = (),
) -> Files:
    """Return the files of kinds that need only a program, which may have been written by hand.

    ``spikes``, ``title`` and ``probes`` are those of :class:`ShownRecording`. Raises ``InputError``
    for kinds about a model, and for vectors, timeline and SANA-FE of an open core.
    """
    shown = ShownRecording(spikes, title, probes)
    return emitted_files(Build(program, shown=shown), kinds)
