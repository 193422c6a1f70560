"""Reads dataclasses from YAML, refusing in one line what they do not name: chips and energy profiles."""

from collections.abc import Collection, Mapping
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from hw_model.description.counts import BY_CORE, COUNT_NAMES
from hw_model.description.profile import NotIncluded, Profile, Range
from hw_model.errors import InputError, did_you_mean
from hw_model.io.files import parsing, read_bytes
from hw_model.io.yaml_text import load_yaml
from hw_model.values import Frozen

T = TypeVar("T")
MAX_FILE_BYTES = 1 << 20
TIMED = (*BY_CORE, "neuron_updates_inactive", "packets_received")
"""Counts that a profile may give a time."""
LARGEST = 2**40
"""No number of a description is as large; most have narrower bounds."""
_MAY_BE_ZERO = ("bias_exponent_max", "delay_max", "run_header_bits")
_COUNTED = {"energy_pj": COUNT_NAMES, "bound_pj": COUNT_NAMES, "time_ns": TIMED}
"""What the costs of a mapping are of, by its key."""


def read_description(path: Path, what: str, example: str) -> str:
    """Return the text of a file that describes a chip or a profile; ``example``: files that it should be like."""
    missing = f"Give the path of a {what} YAML file."
    content = read_bytes(path, path.name, MAX_FILE_BYTES, f"Give a {what} file like {example}.", missing)
    with parsing(path.name, "it is not UTF-8 text", fix=missing):
        return content.decode("utf-8")


def parse(cls: type[T], text: str, where: str, key: str, **given: object) -> T:
    """Read a dataclass from YAML text; every missing, unknown or mistyped key is an ``InputError``."""
    document = load_yaml(text, where, f"the {key} file is not YAML{{line}}", "Compare it with a chip that ships.")
    return _Reader(where).build(cls, document, key, **given)


class _Reader(Frozen):
    where: str

    def build(self, cls: type[T], value: object, key: str, **given: object) -> T:
        hints = get_type_hints(cls)
        wanted = {item.name: item for item in fields(cls) if item.name not in given}  # type: ignore[arg-type]
        mapping, read = self.mapping(value, key), dict[str, object]()
        for name in mapping:
            if name not in wanted:
                raise self.error(key, f"unknown key {name!r}", did_you_mean(name, wanted))
        for name, item in wanted.items():
            if name in mapping:
                read[name] = self.value(hints[name], mapping[name], name)
                self.within(item, read[name])
            elif item.default is MISSING and item.default_factory is MISSING:
                raise self.error(key, f"the key {name!r} is missing", "Add it.")
        made = cls(**given, **read)
        if isinstance(made, Profile):
            self.check_profile(made)
        return made

    def value(self, hint: Any, value: object, key: str) -> object:
        """Return a value as its annotation asks; messages name it by its key."""
        if hint in (int, float):
            return self.number(value, key, whole=hint is int)
        if hint is str:
            return self.text(value, key)
        if hint == Range:
            return self.range(value, key)
        if hint == tuple[NotIncluded, ...]:
            if not isinstance(value, list):
                raise self.error(key, "not a list", "List texts.")
            return tuple(self.left_out(item, key) for item in value)
        kind, parts = get_origin(hint), get_args(hint)
        if kind is Mapping:
            return self.values(parts[1], self.mapping(value, key), key)
        if type(None) in parts:
            return None if value is None else self.value(parts[0], value, key)
        return self.build(hint, value, key)

    def values(self, hint: Any, mapping: dict[str, object], key: str) -> dict[str, object]:
        """Return what a mapping holds by name; costs and profiles go by their own names in messages."""
        if hint is Profile and not mapping:
            raise self.error(key, "no energy profile is given", "Give at least one.")
        for name in mapping if key in _COUNTED else ():
            self.known(name, key, _COUNTED[key])
        own = hint in (float, Profile)
        return {name: self.value(hint, item, name if own else f"{key}: {name}") for name, item in mapping.items()}

    def within(self, item: Field[Any], value: Any) -> None:
        """Refuse a number that no simulation here could follow, where the field has a least and a most."""
        least, most = item.metadata.get("within", (None, None))
        if value is not None and least is not None and not least <= value <= most:
            raise self.error(
                item.name, "the model has no such chip", "Correct it.", f"{value} against {least} to {most}"
            )

    def mapping(self, value: object, key: str) -> dict[str, object]:
        if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
            raise self.error(key, "not a mapping of names", "Compare it with a chip that ships.")
        return value

    def number(self, value: object, key: str, *, whole: bool) -> int | float:
        kinds = int if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not value >= 0:
            kind = "whole number" if whole else "number"
            raise self.error(key, f"{value!r} is not a {kind} from 0 up", "Correct it.")
        if value >= LARGEST:
            shown = value if isinstance(value, float) else min(value, 10**300)
            raise self.error(key, "the number is too large", "Correct it.", f"{shown:.6g} against less than 2^40")
        if whole and key not in _MAY_BE_ZERO and value == 0:
            raise self.error(key, "0 leaves nothing to place on", "Give at least 1.")
        return value if whole else float(value)

    def text(self, value: object, key: str) -> str:
        if not isinstance(value, str) or not value or len(value) > 500:
            raise self.error(key, "not a text of 1 to 500 characters", "Correct it.")
        return value

    def left_out(self, value: object, key: str) -> NotIncluded:
        return self.build(NotIncluded, value, key) if isinstance(value, dict) else NotIncluded(self.text(value, key))

    def range(self, value: object, key: str) -> Range:
        if not isinstance(value, list) or len(value) != 2:
            raise self.error(key, f"{value!r} is not a range", "Give [least, most], null for what is not known.")
        low, high = (None if end is None else float(self.number(end, key, whole=False)) for end in value)
        return low, high

    def check_profile(self, profile: Profile) -> None:
        """Refuse ranges that their constant is not in, and sources and ranges of what has no price."""
        for key, ranges, costs in (
            ("energy_pj_range", profile.energy_pj_range, profile.energy_pj),
            ("time_ns_range", profile.time_ns_range, profile.time_ns),
        ):
            for name, (low, high) in ranges.items():
                self.known(name, key, costs)
                if not (low or 0.0) <= costs[name] <= (costs[name] if high is None else high):
                    ends = f"{'' if low is None else f'{low:g}'} to {'' if high is None else f'{high:g}'}".strip()
                    raise self.error(
                        f"{key}: {name}", f"the constant {costs[name]:g} is not within {ends}", "Correct it."
                    )
        for name in profile.sources:
            self.known(name, "sources", {**profile.energy_pj, **profile.time_ns})

    def known(self, name: str, key: str, names: Collection[str]) -> None:
        if name not in names:
            what = "is not counted" if key in _COUNTED else "has no constant"
            raise self.error(key, f"{name!r} {what}", did_you_mean(name, names) if names else "Leave it out.")

    def error(self, key: str, what: str, fix: str, measured: str = "") -> InputError:
        return InputError(f"{self.where}: {key}", what, measured=measured, fix=fix)
