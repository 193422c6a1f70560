"""Read the YAML files of chips, energy profiles and boards."""

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
"""Letters of the name of a chip."""
ChipName = Annotated[
    str,
    Must(
        lambda name: 0 < len(name) <= LONGEST_NAME and name.isprintable(),
        f"of 1 to {LONGEST_NAME} letters that can be printed",
    ),
]
MAX_FILE_BYTES = 1 << 20
TIMED = (*BY_CORE, "neuron_updates_inactive", "packets_received")
"""Counts that a profile may give a time."""


def is_yaml_path(name_or_path: str | Path) -> bool:
    """Tell the path of a user's file of a chip or a profile from a name."""
    return str(name_or_path).endswith(_YAML)


def read_chip_file(path: Path) -> str:
    """Return the text of a file that describes a chip."""
    return read_description(path, "chip", "those that `locsnn targets` lists")


def read_description(path: Path, what: str, example: str) -> str:
    """Return the text of a file that describes a chip, a profile or a board.

    ``example``: files that it should be like.
    """
    missing = f"Give the path of a {what} YAML file."
    content = read_bytes(
        path, path.name, MAX_FILE_BYTES, f"Give a {what} file like {example}.", missing
    )
    with parsing(path.name, "it is not UTF-8 text", fix=missing):
        return content.decode("utf-8")


def parse(kind: type[T], text: str, where: str, like: str = _SHIPPED, **given: Any) -> T:
    """Read a record from YAML text; every missing, unknown or mistyped key is an ``InputError``.

    ``like``: what errors tell to compare the text with.
    """
    return RecordReader(where).record(kind, plain_values(text, where, like), **given)


def plain_values(text: str, where: str, like: str = _SHIPPED) -> object:
    """Return the plain values of a description."""
    return load_yaml(text, where, "it is not YAML{line}", f"Compare it with {like}.")


_NOT_PRICED = {
    "skipped_steps": ("depends on the engine, not on the chip", "Leave it out."),
    "cycles": (
        "is 0 in simulations, which do not run the core",
        "Give power that does not depend on work as static_power.",
    ),
}
"""Counts without a price: why, and what to do instead."""


def check_profile(profile: Profile, where: str) -> None:
    """Refuse no prices, prices of what no chip counts, ranges beside their constant, and sources of no constant.

    A hop is priced once, and a barrier of more tiles takes no less time.
    """
    if not profile.energy_pj:
        what = "it prices nothing, so everything would take 0 pJ"
        raise InputError(f"{where}: energy_pj", what, fix="Price a count.")
    for key, names, known, what in (
        ("energy_pj", profile.energy_pj, COUNT_NAMES, "is not counted"),
        ("time_ns", profile.time_ns, TIMED, "is not counted"),
        *(
            ("not_included", left_out.bound_pj, COUNT_NAMES, "is not counted")
            for left_out in profile.not_included
        ),
        ("energy_pj_range", profile.energy_pj_range, profile.energy_pj, "has no constant"),
        ("time_ns_range", profile.time_ns_range, profile.time_ns, "has no constant"),
        ("sources", profile.sources, {**profile.energy_pj, **profile.time_ns}, "has no constant"),
    ):
        for name in names:
            if name in _NOT_PRICED:
                what, fix = _NOT_PRICED[name]
                raise InputError(f"{where}: {key}", f"{name!r} {what}", fix=fix)
            check_known(f"{where}: {key}", f"{name!r} {what}", name, known)
    if "hops" in profile.energy_pj and not {"hops_x", "hops_y"}.isdisjoint(profile.energy_pj):
        what, fix = (
            "'hops' are hops_x and hops_y together, which would be priced twice",
            "Price either.",
        )
        raise InputError(f"{where}: energy_pj", what, fix=fix)
    one = profile.barrier_ns.one_tile
    every = profile.barrier_ns.all_tiles
    check_most(
        one,
        every,
        f"{where}: barrier_ns",
        "one tile takes longer than all tiles",
        unit="ns",
        fix="Correct it.",
    )
    for key in ("energy_pj", "time_ns"):
        for name, (low, high) in getattr(profile, f"{key}_range").items():
            constant = getattr(profile, key)[name]
            if not (low or 0.0) <= constant <= (constant if high is None else high):
                what = f"the constant {constant:g} is not within {'' if low is None else f'{low:g} '}to"
                end = "" if high is None else f" {high:g}"
                raise InputError(f"{where}: {key}_range.{name}", f"{what}{end}", fix="Correct it.")
