"""The contents of a program as figures, by which two builds are compared."""

import re
from collections.abc import Mapping
from dataclasses import asdict, fields
from hashlib import sha256
from typing import Annotated, Any

import numpy as np

import hw_model as hw
from hw_model.description.chip import Registers
from hw_model.program.chip_program import Core
from hw_model.program.write import program_arrays, program_document
from hw_model.values import IntArray
from locsnn_compile.report.figures.entries import Entry, IfKnown, Inlined

_ORIGIN = ("name", "target", "provenance", "synapses_pruned")
"""Entries of a program that say where it came from; no spike, score or cost depends on them."""
_ORIGIN_OF_CHIP = ("name", "description", "document")


class Ends(Entry):
    """The least, or the largest, of each setting of a group; no weights or delays without synapses.

    Weights are those that are added to q.
    """

    decay_u: int
    decay_v: int
    refractory: int
    threshold_voltage: int
    bias: int
    synaptic_delay: IfKnown[int]
    weight: IfKnown[int]


def _named(beginning: str) -> Inlined:
    return Inlined(tuple((field.name, f"{beginning}_{field.name}") for field in fields(Ends)))


class GroupFigures(Entry):
    """A group of compartments, with the synapses onto it."""

    compartments: int
    synapses: int
    weights_sum: int
    weights_magnitude: int
    least: Annotated[Ends, _named("least")]
    largest: Annotated[Ends, _named("largest")]


class ProgramFigures(Entry):
    """Sizes and settings of a program.

    ``contents`` has a checksum of every kind of entry and array of the program's files, apart from
    its origin.
    """

    cores: int
    registers: Registers
    groups: Mapping[str, GroupFigures]
    contents: Mapping[str, str]

    @property
    def synapses(self) -> int:
        """Synapses of all groups."""
        return sum(group.synapses for group in self.groups.values())


Settings = dict[str, IntArray]
"""Values by setting, the names of which are those of :class:`Ends`."""


def program_figures(program: hw.ChipProgram) -> ProgramFigures:
    """Return the figures of a program."""
    slices_of_group: dict[str, list[Settings]] = {}
    for core in program.cores:
        for piece in core.slices:
            settings = _settings(core, range(piece.offset, piece.offset + piece.size))
            slices_of_group.setdefault(piece.group, []).append(settings)
    return ProgramFigures(
        cores=len(program.cores),
        registers=program.chip.registers,
        groups={name: _group(slices) for name, slices in slices_of_group.items()},
        contents=_contents(program),
    )


def _settings(core: Core, compartments: range) -> Settings:
    """Return the settings of some compartments of a core, and of the synapses onto them."""
    own = slice(compartments.start, compartments.stop)
    target = core.axons.target
    onto = (target >= compartments.start) & (target < compartments.stop)
    return {
        "decay_u": core.setting("decay_u")[own],
        "decay_v": core.setting("decay_v")[own],
        "refractory": core.setting("refractory")[own],
        "threshold_voltage": core.threshold_voltage[own],
        "bias": core.bias[own],
        "synaptic_delay": core.axons.delay[onto],
        "weight": core.effective_weights[onto],
    }


def _group(slices: list[Settings]) -> GroupFigures:
    settings = {
        name: np.concatenate([values[name] for values in slices]).astype(np.int64)
        for name in slices[0]
    }
    weights = settings["weight"]
    return GroupFigures(
        compartments=len(settings["decay_u"]),
        synapses=len(weights),
        weights_sum=int(weights.sum()),
        weights_magnitude=int(np.abs(weights).sum()),
        least=Ends(**{name: _least(values) for name, values in settings.items()}),
        largest=Ends(**{name: _largest(values) for name, values in settings.items()}),
    )


def _least(values: IntArray) -> Any:
    return int(values.min()) if len(values) else None


def _largest(values: IntArray) -> Any:
    return int(values.max()) if len(values) else None


def _contents(program: hw.ChipProgram) -> dict[str, str]:
    chip = {key: value for key, value in asdict(program.chip).items() if key not in _ORIGIN_OF_CHIP}
    parts: dict[str, Any] = {**program_document(program), "chip": chip}
    for core in parts.pop("cores"):
        for key, value in core.items():
            parts.setdefault(f"cores.{key}", []).append(value)
    for key, array in program_arrays(program).items():
        content = sha256(array.astype(np.int64).tobytes()).hexdigest()
        parts.setdefault(re.sub(r"\d+/", "s.", key), []).append((key, content))
    return {
        key: sha256(repr(value).encode()).hexdigest()[:12]
        for key, value in parts.items()
        if key not in _ORIGIN
    }
