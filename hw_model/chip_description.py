"""A chip description: register widths, limits, mesh, and named energy and time profiles, read from YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import yaml

from hw_model.counts import BY_CORE, COUNT_NAMES
from hw_model.errors import InputError, did_you_mean

T = TypeVar("T")
MAX_CHIP_FILE_BYTES = 1 << 20


@dataclass(frozen=True)
class Registers:
    """Register widths in bits (sign not counted) and the largest settings."""

    charge_bits: int
    current_bits: int
    voltage_bits: int
    threshold_mantissa_bits: int
    bias_mantissa_bits: int
    bias_exponent_max: int
    refractory_max: int
    delay_max: int

    @property
    def voltage_max(self) -> int:
        """Largest voltage, ``2^voltage_bits - 1``; the smallest is its negative."""
        return (1 << self.voltage_bits) - 1

    @property
    def threshold_mantissa_max(self) -> int:
        """Largest threshold mantissa."""
        return (1 << self.threshold_mantissa_bits) - 1

    @property
    def slots(self) -> int:
        """Accumulator slots a compartment needs: one for every delay, the step being read and the next."""
        return self.delay_max + 2


@dataclass(frozen=True)
class Mesh:
    """Tiles of a chip in columns and rows; packets travel x first, then y."""

    columns: int
    rows: int
    cores_per_tile: int

    @property
    def tiles(self) -> int:
        """Tiles of one chip."""
        return self.columns * self.rows


@dataclass(frozen=True)
class Limits:
    """What one core, or one chip, holds at most."""

    cores_per_chip: int
    compartments_per_core: int
    input_axons_per_core: int
    output_axons_per_core: int
    synapse_words_per_core: int
    synapse_formats_per_core: int
    compartment_profiles_per_core: int
    threshold_profiles_per_core: int


@dataclass(frozen=True)
class SynapseMemory:
    """Cost of an axon's synapse list, in memory words."""

    word_bits: int
    run_length: int
    run_header_bits: int

    def words(self, synapses: int, bits_per_synapse: int) -> int:
        """Return the words of a list: each started run costs its header and synapses, rounded up to a word."""
        full, rest = divmod(synapses, self.run_length)
        return full * self._run(self.run_length, bits_per_synapse) + (self._run(rest, bits_per_synapse) if rest else 0)

    def _run(self, synapses: int, bits_per_synapse: int) -> int:
        return -(-(self.run_header_bits + synapses * bits_per_synapse) // self.word_bits)


@dataclass(frozen=True)
class Barrier:
    """Time of the mesh-wide barrier, for one tile and for all tiles of a chip."""

    one_tile: float
    all_tiles: float

    def ns(self, tiles: int, all_tiles: int) -> float:
        """Interpolate linearly between the two published ends."""
        share = (tiles - 1) / max(all_tiles - 1, 1)
        return self.one_tile + share * (self.all_tiles - self.one_tile)


@dataclass(frozen=True)
class Profile:
    """One published set of costs: picojoules and nanoseconds for each count it prices."""

    source: str
    basis: str
    energy_pj: Mapping[str, float]
    time_ns: Mapping[str, float]
    barrier_ns: Barrier
    not_included: tuple[str, ...]


@dataclass(frozen=True)
class Chip:
    """A chip and its board, as `hw_model/chips/*.yaml` describes it."""

    name: str
    description: str
    chips: int
    clock_ghz: float
    registers: Registers
    mesh: Mesh
    limits: Limits
    synapse_memory: SynapseMemory
    profiles: Mapping[str, Profile]
    document: str
    """The YAML text that this chip was read from: a saved program carries it."""

    @property
    def cores(self) -> int:
        """Cores of the whole board."""
        return self.chips * self.limits.cores_per_chip

    def tile_of(self, slot: int) -> tuple[int, int]:
        """Return (column, row) of a core's tile on the board: cores fill tiles row by row, chips lie side by side."""
        chip, core = divmod(slot, self.limits.cores_per_chip)
        row, column = divmod(core // self.mesh.cores_per_tile, self.mesh.columns)
        return chip * self.mesh.columns + column, row

    def hops(self, source_slot: int, target_slot: int) -> tuple[int, int]:
        """Return (east-west, north-south) hops between two cores of the board."""
        (x0, y0), (x1, y1) = self.tile_of(source_slot), self.tile_of(target_slot)
        return abs(x0 - x1), abs(y0 - y1)

    @property
    def default_profile(self) -> str:
        """Name of the energy profile that reports show first: the first of the chip file."""
        return next(iter(self.profiles))

    def profile(self, name: str) -> Profile:
        """Return the named profile, or say which exist."""
        if name not in self.profiles:
            raise InputError(
                f"chip {self.name}",
                f"there is no energy profile {name!r}",
                fix=did_you_mean(name, self.profiles),
            )
        return self.profiles[name]


def chip(name_or_path: str | Path) -> Chip:
    """Return a chip by the name of a description that ships, or by the path of a YAML file."""
    text = str(name_or_path)
    if not text.endswith((".yaml", ".yml")):
        if text not in chip_names():
            raise InputError(
                f"target {text!r}",
                "no chip of this name ships",
                fix=did_you_mean(text, chip_names()) + " A chip file of your own ends in .yaml.",
            )
        return parse_chip((files("hw_model") / "chips" / f"{text}.yaml").read_text("utf-8"), where=text)
    path = Path(text)
    try:
        if path.stat().st_size > MAX_CHIP_FILE_BYTES:
            raise InputError(
                path.name,
                "the file is too large for a chip description",
                measured=f"{path.stat().st_size} bytes against {MAX_CHIP_FILE_BYTES}",
                fix="Give a chip file like those that `locsnn targets` lists.",
            )
        return parse_chip(path.read_text("utf-8"), where=path.name)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            path.name,
            f"the chip file cannot be read: {_reason(error)}",
            fix="Give the path of a chip YAML file.",
        ) from error


def chip_names() -> tuple[str, ...]:
    """Return the names of the chips that ship."""
    names = (entry.name for entry in (files("hw_model") / "chips").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml")))


def parse_chip(text: str, where: str) -> Chip:
    """Read a chip from YAML text; every missing, unknown or mistyped key is an ``InputError``."""
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        raise InputError(
            where,
            "the chip file is not YAML" + ("" if line is None else f" at line {line + 1}"),
            fix="Compare it with a chip that ships.",
        ) from error
    return _Reader(where).build(Chip, document, "chip", document=text)


def _reason(error: OSError | UnicodeDecodeError) -> str:
    return "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else (error.strerror or "unknown")


@dataclass(frozen=True)
class _Reader:
    """Builds the dataclasses above from nested mappings, refusing anything they do not name."""

    where: str

    def build(self, cls: type[T], value: object, key: str, **given: object) -> T:
        hints = get_type_hints(cls)
        wanted = [field.name for field in fields(cls) if field.name not in given]  # type: ignore[arg-type]
        mapping = self.mapping(value, key)
        for name in mapping:
            if name not in wanted:
                raise self.error(key, f"unknown key {name!r}", did_you_mean(str(name), wanted))
        for name in wanted:
            if name not in mapping:
                raise self.error(key, f"the key {name!r} is missing", "Add it.")
        return cls(**given, **{name: self.value(hints[name], mapping[name], name) for name in wanted})

    def value(self, hint: Any, value: object, key: str) -> object:
        if hint is int:
            return self.number(value, key, whole=True)
        if hint is float:
            return self.number(value, key, whole=False)
        if hint is str:
            return self.text(value, key)
        if hint == Mapping[str, float]:
            return self.costs(value, key)
        if hint == Mapping[str, Profile]:
            profiles = self.mapping(value, key)
            if not profiles:
                raise self.error(key, "no energy profile is given", "Give at least one.")
            return {name: self.build(Profile, item, name) for name, item in profiles.items()}
        if hint == tuple[str, ...]:
            if not isinstance(value, list):
                raise self.error(key, "not a list", "List texts.")
            return tuple(self.text(item, key) for item in value)
        return self.build(hint, value, key)

    def mapping(self, value: object, key: str) -> dict[str, object]:
        if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
            raise self.error(key, "not a mapping of names", "Compare it with a chip that ships.")
        return value

    def number(self, value: object, key: str, *, whole: bool) -> int | float:
        kinds = int if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not 0 <= value < 2**40:
            kind = "whole number" if whole else "number"
            raise self.error(key, f"{value!r} is not a {kind} from 0 up", "Correct it.")
        if whole and key not in ("bias_exponent_max", "delay_max", "run_header_bits") and value == 0:
            raise self.error(key, "0 leaves nothing to place on", "Give at least 1.")
        return value if whole else float(value)

    def text(self, value: object, key: str) -> str:
        if not isinstance(value, str) or not value or len(value) > 500:
            raise self.error(key, "not a text of 1 to 500 characters", "Correct it.")
        return value

    def costs(self, value: object, key: str) -> dict[str, float]:
        costs = {}
        for name, cost in self.mapping(value, key).items():
            known = COUNT_NAMES if key == "energy_pj" else (*BY_CORE, "neuron_updates_inactive")
            if name not in known:
                raise self.error(key, f"{name!r} is not counted", did_you_mean(name, known))
            costs[name] = float(self.number(cost, name, whole=False))
        return costs

    def error(self, key: str, what: str, fix: str) -> InputError:
        return InputError(f"{self.where}: {key}", what, fix=fix)
