"""Summarise a program as figures, so that ``locsnn diff`` can say how two builds differ.

The figures are sizes, the range of each setting and of the weights by group of compartments, and a
checksum of each part of the program's files.
"""

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
"""Entries of a program that say where it came from. They have no checksum: no spike, score or cost depends on them."""
_ORIGIN_OF_CHIP = ("name", "description", "document")
"""The same for the chip of a program."""


class Ends(Entry):
    """One end of the range of each setting in a group: the least values, or the largest.

    ``weight`` is the effective weight, which a spike adds to the charge q; it and the delay are absent where
    no synapse leads to the group.
    """

    decay_u: int
    decay_v: int
    refractory: int
    threshold_voltage: int
    bias: int
    synaptic_delay: IfKnown[int]
    weight: IfKnown[int]


def _with_prefix(prefix: str) -> Inlined:
    """Return the mark of a field of type :class:`Ends` whose keys get a prefix in the document."""
    return Inlined(tuple((field.name, f"{prefix}_{field.name}") for field in fields(Ends)))


class GroupFigures(Entry):
    """A group of compartments, with the synapses onto it.

    ``weights_sum`` adds up their effective weights, and ``weights_magnitude`` their absolute values.
    """

    compartments: int
    synapses: int
    weights_sum: int
    weights_magnitude: int
    least: Annotated[Ends, _with_prefix("least")]
    largest: Annotated[Ends, _with_prefix("largest")]


class ProgramFigures(Entry):
    """Sizes and settings of a program; ``contents`` has a checksum of every part of its files except its origin."""

    cores: int
    registers: Registers
    groups: Mapping[str, GroupFigures]
    contents: Mapping[str, str]

    @property
    def synapses(self) -> int:
        """Synapses of all groups."""
        return sum(group.synapses for group in self.groups.values())


Settings = dict[str, IntArray]
"""The values of each setting, (compartments,) or (synapses,); their names are the fields of :class:`Ends`."""


def program_figures(program: hw.ChipProgram) -> ProgramFigures:
    """Return the figures of a program, by which it is compared with another."""
    # A group may be cut into slices, each on a core of its own.
    slices_by_group: dict[str, list[Settings]] = {}
    for core in program.cores:
        for core_slice in core.slices:
            compartments = slice(core_slice.offset, core_slice.offset + core_slice.size)
            settings = _settings(core, compartments)
            slices_by_group.setdefault(core_slice.group, []).append(settings)
    return ProgramFigures(
        cores=len(program.cores),
        registers=program.chip.registers,
        groups={name: _group(slices) for name, slices in slices_by_group.items()},
        contents=_contents(program),
    )


def _settings(core: Core, compartments: slice) -> Settings:
    """Return the settings of some compartments of a core, and of the synapses onto them."""
    target = core.axons.target
    is_onto = (target >= compartments.start) & (target < compartments.stop)
    return {
        "decay_u": core.setting("decay_u")[compartments],
        "decay_v": core.setting("decay_v")[compartments],
        "refractory": core.setting("refractory")[compartments],
        "threshold_voltage": core.threshold_voltage[compartments],
        "bias": core.bias[compartments],
        "synaptic_delay": core.axons.delay[is_onto],
        "weight": core.effective_weights[is_onto],
    }


def _group(slices: list[Settings]) -> GroupFigures:
    """Return the figures of a group, given the settings of its slices."""
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
    """Return a checksum of each part of the program's files, by its key.

    Cores are many, so they are not compared one by one: each setting has one checksum over all cores.
    """
    chip = {key: value for key, value in asdict(program.chip).items() if key not in _ORIGIN_OF_CHIP}
    parts: dict[str, Any] = {**program_document(program), "chip": chip}
    for core in parts.pop("cores"):
        for key, value in core.items():
            parts.setdefault(f"cores.{key}", []).append(value)
    for key, array in program_arrays(program).items():
        # One width for all, so that equal numbers have equal bytes.
        checksum = sha256(array.astype(np.int64).tobytes()).hexdigest()
        # ``core12/weight`` becomes ``cores.weight``.
        key_of_all_cores = re.sub(r"\d+/", "s.", key)
        parts.setdefault(key_of_all_cores, []).append((key, checksum))
    # 12 digits are 48 bits, enough to tell two builds apart, and short enough to read.
    return {
        key: sha256(repr(value).encode()).hexdigest()[:12]
        for key, value in parts.items()
        if key not in _ORIGIN
    }
