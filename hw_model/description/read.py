"""Read the YAML files of chips, energy profiles and boards, and check profiles.

A *profile* is a published set of costs: picojoules and nanoseconds for each unit of a count, such as a spike
(:mod:`hw_model.description.profile`). Its *constants* are these costs by the name of their count.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, TypeVar

from hw_model.description.counts import BY_CORE, COUNT_NAMES
from hw_model.description.profile import Profile
from hw_model.errors import InputError, check_known, check_most
from hw_model.io.files import parsing, read_bytes
from hw_model.io.records import Must, RecordReader
from hw_model.io.yaml_text import load_yaml

T = TypeVar("T")
_YAML = (".yaml", ".yml")
_SHIPPED = "a chip that ships"
LONGEST_NAME = 100
"""The most letters of the name of a chip. Chosen by hand."""
ChipName = Annotated[
    str,
    Must(
        lambda name: 0 < len(name) <= LONGEST_NAME and name.isprintable(),
        f"of 1 to {LONGEST_NAME} letters that can be printed",
    ),
]
MAX_FILE_BYTES = 1 << 20
"""The longest description, in bytes; the files that ship have 11 kB at most."""
TIMED = (*BY_CORE, "neuron_updates_inactive", "packets_received")
"""Counts that a profile may give a time: those known for each step and core, and two that are derived from them there
(:meth:`hw_model.accounting.activity.StepActivity.count`), since a step lasts as long as its slowest core."""


def is_yaml_path(name_or_path: str | Path) -> bool:
    """Return whether a text is the path of a user's file, not the name of a file that ships."""
    return str(name_or_path).endswith(_YAML)


def read_chip_file(path: Path) -> str:
    """Return the text of a file that describes a chip."""
    return read_description(path, "chip", "those that `locsnn targets` lists")


def read_description(path: Path, what: str, example: str) -> str:
    """Return the text of a file that describes a chip, a profile or a board.

    ``what`` it describes, and an ``example`` that it should be like, are named in errors.
    """
    missing = f"Give the path of a {what} YAML file."
    content = read_bytes(
        path,
        where=path.name,
        most=MAX_FILE_BYTES,
        fix=f"Give a {what} file like {example}.",
        missing=missing,
    )
    with parsing(path.name, "it is not UTF-8 text", fix=missing):
        return content.decode("utf-8")


def parse(kind: type[T], text: str, where: str, like: str = _SHIPPED, **given: Any) -> T:
    """Read a record from YAML text; every missing, unknown or mistyped key is an ``InputError``.

    Errors advise to compare the text with ``like``. ``given`` are fields that are not read from the
    text.
    """
    return RecordReader(where).record(kind, plain_values(text, where, like), **given)


def plain_values(text: str, where: str, like: str = _SHIPPED) -> object:
    """Return the plain values of a description: mappings, lists, numbers and texts."""
    # Not an f-string: load_yaml replaces {line} by the place of the fault in the text.
    fault = "it is not YAML{line}"
    return load_yaml(text, where, fault, fix=f"Compare it with {like}.")


_NOT_PRICED = {
    "skipped_steps": ("depends on the engine, not on the chip", "Leave it out."),
    "cycles": (
        "is 0 in simulations, which do not run the core",
        "Give power that does not depend on work as static_power.",
    ),
}
"""Counts that no profile may price: why not, and what to do instead. The simulators play programs compartment by
compartment; only the open core itself, in a simulation of its RTL or on a board, has clock cycles to count."""


def check_profile(profile: Profile, where: str) -> None:
    """Raise an ``InputError`` if a profile cannot be right.

    It has to price something, and may only price what is counted. Ranges and sources must belong to
    constants, and a range must contain its constant. A hop is priced once, and a barrier of more
    tiles takes no less time.
    """
    if not profile.energy_pj:
        what = "it prices nothing, so everything would take 0 pJ"
        raise InputError(f"{where}: energy_pj", what, fix="Price a count.")
    _check_names(profile, where)
    if "hops" in profile.energy_pj and not {"hops_x", "hops_y"}.isdisjoint(profile.energy_pj):
        what = "'hops' are hops_x and hops_y together, which would be priced twice"
        raise InputError(f"{where}: energy_pj", what, fix="Price either.")
    check_most(
        profile.barrier_ns.one_tile,
        profile.barrier_ns.all_tiles,
        f"{where}: barrier_ns",
        "one tile takes longer than all tiles",
        unit="ns",
        fix="Correct it.",
    )
    _check_ranges(profile, where)


def _check_names(profile: Profile, where: str) -> None:
    """Refuse names of no count, of counts that have no price, and of no constant."""
    constants = {**profile.energy_pj, **profile.time_ns}
    # Each row: a key of the profile, the names it has there, the names it may have, and what an error says about any
    # other name.
    rows: list[tuple[str, Collection[str], Collection[str], str]] = [
        ("energy_pj", profile.energy_pj, COUNT_NAMES, "is not counted"),
        ("time_ns", profile.time_ns, TIMED, "is not counted"),
    ]
    for entry in profile.not_included:
        # A bound of what a profile leaves out is also given by count.
        rows.append(("not_included", entry.bound_pj, COUNT_NAMES, "is not counted"))
    rows += [
        ("energy_pj_range", profile.energy_pj_range, profile.energy_pj, "has no constant"),
        ("time_ns_range", profile.time_ns_range, profile.time_ns, "has no constant"),
        ("sources", profile.sources, constants, "has no constant"),
    ]
    for key, names, allowed, what in rows:
        for name in names:
            if name in _NOT_PRICED:
                reason, fix = _NOT_PRICED[name]
                raise InputError(f"{where}: {key}", f"{name!r} {reason}", fix=fix)
            check_known(f"{where}: {key}", f"{name!r} {what}", name, allowed)


def _check_ranges(profile: Profile, where: str) -> None:
    """Refuse ranges that do not contain their constant."""
    for key in ("energy_pj", "time_ns"):
        for name, (least, most) in getattr(profile, f"{key}_range").items():
            constant = getattr(profile, key)[name]
            # Without a least value, 0 is one; without a largest value there is no limit.
            is_too_low = constant < (least or 0.0)
            is_too_high = most is not None and constant > most
            if is_too_low or is_too_high:
                from_least = "" if least is None else f"{least:g} "
                to_most = "" if most is None else f" {most:g}"
                what = f"the constant {constant:g} is not within {from_least}to{to_most}"
                raise InputError(f"{where}: {key}_range.{name}", what, fix="Correct it.")
