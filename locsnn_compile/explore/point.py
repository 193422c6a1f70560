"""Points of an exploration: a setting that was compiled and checked on recordings, or that the chip refused.

A setting is one value for each dial of the compiler, such as the weight bits (``settings.py``). All points share a
*study*: a model, a chip, recordings, and the engines of the simulator to time. A point is stored under a hash of
everything that determines it, so that a command that was stopped measures no point twice.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path

import hw_model as hw
from hw_model.simulation import Engine
from hw_model.values import Frozen
from locsnn_compile.api import fulfil
from locsnn_compile.cluster.spread import code_version
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import TargetError
from locsnn_compile.explore.timing import Timing, engine_timings
from locsnn_compile.frontends import load
from locsnn_compile.frontends.format_rows import LoadOptions
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.request.compile_request import CheckRequest, CompileRequest, SettingRequest
from locsnn_compile.settings import Setting
from locsnn_compile.verification.error_bounds import Losses


class ModelFile(Frozen):
    """The arguments of :func:`locsnn_compile.load`: a path, and options."""

    model: str
    options: LoadOptions = LoadOptions()

    def load(self) -> Network:
        """Read the model; ``InputError`` for what cannot be read or used."""
        return load(self.model, **vars(self.options))

    def arguments(self) -> list[str]:
        """Return the arguments by which ``locsnn-compile`` reads the same model."""
        arguments = [self.model]
        for name, value in self.options.given.items():
            arguments.append(f"--{name.replace('_', '-')}")
            if value is not True:  # a flag has no value
                arguments.append(str(value))
        return arguments

    def digest(self) -> str:
        """Return a hash of everything that determines the network: the bytes of its files, and the options."""
        config = self.options.config
        paths = [self.model] if config is None else [self.model, config]
        contents = [Path(path).read_bytes() for path in paths]
        # The lengths say where one file ends and the next one begins: without them, bytes that move from one file to
        # the other would not change the hash.
        lengths = [len(content) for content in contents]
        # The content of --config is hashed, so its path, which may differ, is left out.
        options = vars(replace(self.options, config=None))
        return digest_of([options, lengths], *contents)


class Study(Frozen, eq=False):
    """What all points share. ``model_digest`` is :meth:`ModelFile.digest` of the file of ``network``.

    Weights are rounded for the ``calibration`` recordings, programs are checked on ``recordings``, and ``engines`` of
    the simulator are timed.
    """

    network: Network
    model_digest: str
    chip: hw.Chip
    recordings: Recordings
    calibration: Recordings
    engines: tuple[Engine, ...] = ()

    def request(self, setting: Setting) -> CompileRequest[hw.Chip]:
        """Return what is asked of the compiler for a point; its report needs no diagnosis.

        Raises ``TargetError`` for a setting that the chip does not have.
        """
        setting.check(self.chip)
        # Every dial counts as given by the user, so that the compiler keeps its value and tries no other.
        all_dials = frozenset(asdict(setting))
        setting_request = SettingRequest(setting, all_dials, calibration=self.calibration)
        check_request = CheckRequest(self.recordings, diagnosis=False)
        return CompileRequest(self.network, self.chip, setting_request, check_request)

    def key(self, setting: Setting) -> str:
        """Return the name of a stored point: a hash of model, recordings, chip, engines, setting and code."""
        return digest_of([self._digest, asdict(setting), code_version()])

    @cached_property
    def _digest(self) -> str:
        """A hash of the study: of everything that is the same for all its points."""
        of_recordings = [recordings_digest(self.recordings), recordings_digest(self.calibration)]
        return digest_of(
            [self.network.name, self.model_digest, self.chip.document, self.engines, of_recordings]
        )


def digest_of(values: object, *contents: bytes) -> str:
    """Return a hash of values that JSON can hold, and of bytes."""
    digest = hashlib.sha256(json.dumps(values).encode())
    for content in contents:
        digest.update(content)
    return digest.hexdigest()


def recordings_digest(recordings: Recordings) -> str:
    """Return a hash of recordings: their events, labels and width of a step."""
    spikes = recordings.spikes
    labels = recordings.labels
    # Little-endian integers of eight bytes, so that all machines of a cluster get the same hash.
    label_bytes = b"" if labels is None else labels.astype("<i8").tobytes()
    # The shape, because arrays of different shapes may have equal bytes.
    values = [spikes.shape, labels is not None, recordings.step_seconds]
    return digest_of(values, spikes.tobytes(), label_bytes)


class Figures(Losses):
    """The figures of a setting's report: what it loses and costs (see ``Losses``), and what the program takes.

    Energy and chip time are means per recording by the chip's default profile. ``accuracy`` is that of the chip and
    ``float_accuracy`` that of the float network; both are None without labels.
    """

    accuracy: float | None
    float_accuracy: float | None
    energy_profile: str | None
    cores: int
    compartments: int
    synapses: int
    synapse_bits: int
    wraps: int
    clips: int

    @classmethod
    def of(cls, report: ReportFigures) -> "Figures":
        """Return the figures of a report."""
        match = report.match
        energy = report.energy
        accuracy = report.accuracy
        resources = report.resources
        return cls(
            prediction_agreement=match.prediction_agreement,
            spike_agreement=match.spikes.spike_agreement,
            score_error=match.score_error,
            energy_pj=None if energy is None else energy.per_sample_pj,
            chip_time_ns=report.latency.per_sample_ns,
            accuracy=None if accuracy is None else accuracy.chip,
            float_accuracy=None if accuracy is None else accuracy.reference,
            energy_profile=None if energy is None else energy.profile,
            cores=resources.cores,
            compartments=resources.compartments,
            synapses=resources.synapses,
            synapse_bits=resources.synapse_bits,
            wraps=match.wraps,
            clips=match.clips,
        )


class Point(Frozen):
    """A setting with its figures or refusal, ``timings`` by engine, and the version of the code that measured it.

    ``refusal`` are the arguments of the ``TargetError`` by name: they can be compared and stored, as an error cannot.
    """

    setting: Setting
    figures: Figures | None
    refusal: Mapping[str, str] | None
    timings: Mapping[str, Timing]
    code: str

    @property
    def refused(self) -> TargetError | None:
        """Why the chip cannot hold the setting."""
        return TargetError(**self.refusal) if self.refusal else None


def measure(study: Study, setting: Setting) -> Point:
    """Compile and check a setting as ``locsnn-compile`` does, then time each engine.

    A setting that the chip cannot hold is also a point. An ``InputError`` would be the same for all settings, so it is
    raised.
    """
    try:
        compiled = fulfil(study.request(setting))
    except TargetError as error:
        return Point(setting, figures=None, refusal=vars(error), timings={}, code=code_version())
    return Point(
        setting,
        figures=Figures.of(compiled.figures),
        refusal=None,
        timings=engine_timings(compiled.program, compiled.observed.recordings, study.engines),
        code=code_version(),
    )
