"""A chip as its YAML file describes it: registers, limits, mesh, and profiles of energy and time.

The description serves Loihi-like meshes and the open core. Chips with another arithmetic (Xylo,
SpiNNaker) have descriptions of their own. Numbers that contradict each other are refused when a
file is read.
"""

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS, half_range
from hw_model.description.boards import BOARDS
from hw_model.description.open_core import Macro, MemoryWords, Sizes, check_sizes
from hw_model.description.profile import UNPRICED, Profile, Text
from hw_model.description.read import (
    check_profile,
    is_yaml_path,
    parse,
    read_chip_file,
    read_description,
)
from hw_model.errors import InputError, check_known, check_most
from hw_model.io.arguments import checked
from hw_model.io.records import NOT_NEGATIVE, POSITIVE, between
from hw_model.values import Frozen, IntArray, Shown

_OTHERS = {"xylo-": "a Xylo", "spinnaker": "a SpiNNaker"}
"""How the names of chips with other descriptions begin, and what messages call these chips."""
MAX_CORES = 1 << 20
"""The most cores of a board that can be simulated. Chosen by hand."""


class Registers(Frozen):
    """Register widths in bits (sign not counted) and the largest settings.

    The ranges keep the simulator exact in 64 bits: products with decays need 40 + 12 bits, and sums
    of joined voltages 40 + 20, as a core has at most 2^20 compartments.
    """

    charge_bits: Annotated[int, between(9, 40)]
    current_bits: Annotated[int, between(9, 40)]
    voltage_bits: Annotated[int, between(9, 40)]
    threshold_mantissa_bits: Annotated[int, between(1, 34)]
    bias_mantissa_bits: Annotated[int, between(1, 24)]
    bias_exponent_max: Annotated[int, between(0, 24)]
    refractory_max: Annotated[int, between(1, 65_535)]
    delay_max: Annotated[int, between(0, 65_534)]
    weight_bits_max: Annotated[int, between(1, 8)] = WEIGHT_BITS[-1]

    @property
    def weight_bits(self) -> tuple[int, ...]:
        """The widths of weights, in bits, that synapse formats may have."""
        return tuple(bits for bits in WEIGHT_BITS if bits <= self.weight_bits_max)

    @property
    def half_charge(self) -> int:
        """``2^charge_bits``: q lies within ``-half_charge..half_charge - 1``."""
        return half_range(self.charge_bits)

    @property
    def half_current(self) -> int:
        """``2^current_bits``: u lies within ``-half_current..half_current - 1``."""
        return half_range(self.current_bits)

    @property
    def voltage_max(self) -> int:
        """Largest voltage, ``2^voltage_bits - 1``; the smallest is its negative."""
        return half_range(self.voltage_bits) - 1

    @property
    def threshold_mantissa_max(self) -> int:
        """Largest threshold mantissa."""
        return half_range(self.threshold_mantissa_bits) - 1

    @property
    def bias_mantissa_max(self) -> int:
        """Largest bias mantissa; the smallest is one below its negative."""
        return half_range(self.bias_mantissa_bits) - 1

    @property
    def slots(self) -> int:
        """Accumulator slots that a compartment needs: one per delay, one for the current step and one for the next."""
        return self.delay_max + 2


class Mesh(Frozen):
    """Tiles of a chip in columns and rows; packets travel x first, then y."""

    columns: Annotated[int, between(1, 65_536)]
    rows: Annotated[int, between(1, 65_536)]
    cores_per_tile: Annotated[int, between(1, 65_536)]

    @property
    def tiles(self) -> int:
        """Tiles of one chip."""
        return self.columns * self.rows


class Limits(Frozen):
    """The most that one core, or one chip, can hold."""

    cores_per_chip: Annotated[int, between(1, 65_536)]
    compartments_per_core: Annotated[int, between(1, 1 << 20)]
    input_axons_per_core: Annotated[int, between(1, 1 << 20)]
    output_axons_per_core: Annotated[int, between(1, 1 << 20)]
    synapse_words_per_core: Annotated[int, between(1, 1 << 24)]
    synapse_formats_per_core: Annotated[int, between(1, 65_536)]
    compartment_profiles_per_core: Annotated[int, between(1, 65_536)]
    threshold_profiles_per_core: Annotated[int, between(1, 65_536)]


class SynapseMemory(Frozen):
    """What an axon's list of synapses takes of the memory of synapses.

    A list is stored in runs of up to ``run_length`` synapses. A run has a header of
    ``run_header_bits``, then its synapses, and takes whole words of ``word_bits``.
    """

    word_bits: Annotated[int, between(1, 4_096)]
    run_length: Annotated[int, between(1, 65_536)]
    run_header_bits: Annotated[int, between(0, 1_024)]

    def words(self, synapses: IntArray, bits: IntArray | int) -> IntArray:
        """Return the words of lists, given the number of their synapses and the bits of a synapse."""
        full_runs = synapses // self.run_length
        remaining_synapses = synapses % self.run_length
        words_of_full_run = self._words_of_run(self.run_length, bits)
        words_of_last_run = self._words_of_run(remaining_synapses, bits)
        has_last_run = remaining_synapses > 0
        words: IntArray = full_runs * words_of_full_run + has_last_run * words_of_last_run
        return words

    def _words_of_run(self, synapses: IntArray | int, bits: IntArray | int) -> IntArray:
        """Return the words of a run of synapses, rounded up."""
        run_bits = self.run_header_bits + synapses * np.asarray(bits)
        words: IntArray = -(-run_bits // self.word_bits)
        return words


class TransposeBuffer(Frozen):
    """The buffer that transposes a recording for location phases: an assumption of this model, outside the cores.

    Events are written while the recording arrives. Reading an event takes ``cycles_per_event``.
    """

    cycles_per_event: Annotated[float, NOT_NEGATIVE]


class Chip(Shown, eq=True):
    """A chip and its board, as `hw_model/chips/*.yaml` describes it.

    A board may have several ``chips``, side by side. ``open_core`` holds the sizes of this
    project's core, if the chip is one; ``memory_words`` then says which memories are smaller than
    these sizes would make them, and ``macros`` which macros memories can be made of. Clock cycles
    of such a chip are exact. An FPGA has no energy profile, but a core in the cells of a process
    may have one.
    """

    name: Text
    description: Text
    chips: Annotated[int, between(1, MAX_CORES)]
    clock_ghz: Annotated[float, POSITIVE]
    registers: Registers
    mesh: Mesh
    limits: Limits
    synapse_memory: SynapseMemory
    document: str
    """The YAML text that this chip was read from: a saved program carries it."""
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    transpose_buffer: TransposeBuffer = TransposeBuffer(1.0)
    open_core: Sizes | None = None
    memory_words: MemoryWords | None = None
    macros: Mapping[str, Macro] = field(default_factory=dict)

    @property
    def cores(self) -> int:
        """Cores of the whole board."""
        return self.chips * self.limits.cores_per_chip

    def tile_of(self, slot: int) -> tuple[int, int]:
        """Return (column, row) of a core's tile, given the core's number on the board, ``slot``.

        Cores fill tiles row by row; chips lie side by side.
        """
        chip, core = divmod(slot, self.limits.cores_per_chip)
        row, column = divmod(core // self.mesh.cores_per_tile, self.mesh.columns)
        return chip * self.mesh.columns + column, row

    def hops(self, source_slot: int, target_slot: int) -> tuple[int, int]:
        """Return (east-west, north-south) hops between the tiles of two cores of the board."""
        source_column, source_row = self.tile_of(source_slot)
        target_column, target_row = self.tile_of(target_slot)
        return abs(source_column - target_column), abs(source_row - target_row)

    @property
    def default_profile(self) -> str | None:
        """The name of the first energy profile, which reports show first; None without profiles."""
        return next(iter(self.profiles), None)

    @property
    def costs(self) -> Profile:
        """The default profile, or one that prices nothing."""
        return next(iter(self.profiles.values()), UNPRICED)

    def profile(self, name: str) -> Profile:
        """Return the profile of this name; ``InputError`` lists those that exist."""
        what = f"there is no energy profile {name!r}"
        more = " A profile of your own is a file that ends in .yaml."
        check_known(f"chip {self.name}", what, name, self.profiles, more)
        return self.profiles[name]


@checked
def chip(name_or_path: str | Path) -> Chip:
    """Return a chip, given the name of a description that ships or the path of a YAML file."""
    text = str(name_or_path)
    if not is_yaml_path(text):
        if text in BOARDS:
            what = f"it is a board of {BOARDS[text]}"
            raise InputError(f"target {text!r}", what, fix=f"Give the target {BOARDS[text]}.")
        for beginning, called in _OTHERS.items():
            if not text.startswith(beginning):
                continue
            what = f"{called} computes in another way than the chips that can be used here"
            raise InputError(
                f"target {text!r}", what, fix="Compile for it: locsnn-compile --target."
            )
        more = " A chip file of your own ends in .yaml."
        check_known(f"target {text!r}", "no chip of this name ships", text, chip_names(), more)
        return _shipped(text)
    path = Path(text)
    return parse_chip(read_chip_file(path), where=path.name)


@cache
def _shipped(name: str) -> Chip:
    """Return a chip that ships, whose file is read only once."""
    return parse_chip((files("hw_model") / "chips" / f"{name}.yaml").read_text("utf-8"), where=name)


def chip_names() -> tuple[str, ...]:
    """Return the names of the chips that ship."""
    names = (entry.name for entry in (files("hw_model") / "chips").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml")))


def parse_chip(text: str, where: str) -> Chip:
    """Read a chip from YAML text; every missing, unknown or mistyped key is an ``InputError``."""
    chip = parse(Chip, text, where, document=text)
    for name, profile in chip.profiles.items():
        check_profile(profile, f"{where}: profiles.{name}")
    check_chip(chip, where)
    return chip


def check_chip(chip: Chip, where: str) -> None:
    """Refuse a description that contradicts itself, and a board that is too large to simulate."""
    check_most(
        chip.cores,
        MAX_CORES,
        f"{where}: chips",
        "the board is too large",
        unit="cores",
        fix="Correct it.",
    )
    if chip.open_core:
        check_sizes(chip.open_core, chip.registers.slots, f"{where}: open_core")
    elif not chip.profiles:
        raise InputError(
            f"{where}: profiles",
            "only an open core may have no energy profile",
            fix="Give at least one.",
        )
    mesh = chip.mesh
    if mesh.tiles * mesh.cores_per_tile != chip.limits.cores_per_chip:
        tiles = f"{mesh.columns} x {mesh.rows} tiles of {mesh.cores_per_tile}"
        measured = f"{tiles} against cores_per_chip {chip.limits.cores_per_chip}"
        what = "its tiles and the cores of a chip disagree"
        raise InputError(f"{where}: mesh", what, measured=measured, fix="Make them equal.")


@checked
def priced_by(chip: Chip, name_or_path: str | Path) -> Chip:
    """Return the chip with another profile in first place: one of its own, by name, or one from a YAML file.

    The file has the same keys as a profile in a chip file. The profile gets the file's name, without its ending.
    """
    text = str(name_or_path)
    if not chip.profiles:
        raise InputError(
            f"profile {text!r}",
            f"{chip.name} has cycles and no profiles",
            fix="Leave the profile out.",
        )
    if not is_yaml_path(text):
        return replace(chip, profiles={text: chip.profile(text), **chip.profiles})
    path = Path(text)
    read = parse(Profile, read_description(path, "profile", "those in a chip file"), path.name)
    check_profile(read, path.name)
    if path.stem in chip.profiles:
        fix = "Give the file another name."
        raise InputError(path.name, f"{chip.name} has a profile {path.stem!r} of its own", fix=fix)
    return replace(chip, profiles={path.stem: read, **chip.profiles})
