"""Tables of energy and time: by whatever they are broken down by, constants with their source, and what is left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from locsnn_compile.report.content import Bar, Document, Table
from locsnn_compile.report.format import NONE, count, energy, share
from locsnn_compile.report.words import words

Shown = Callable[[float], str]
_OF_CONSTANTS = {"energy_pj": "pJ", "time_ns": "ns"}


def shares(
    rows: Sequence[tuple[str, float]], caption: str, what: str, shown: Shown, *, of: str, patterned: bool = False
) -> Table:
    """Return parts of a whole with their sum; ``of`` names the whole, ``what`` a part."""
    total = sum(value for _, value in rows)
    made: list[tuple[str | Bar, ...]] = []
    for i, (name, value) in enumerate(rows):
        part = value / total if total else 0.0
        made.append((name, Bar(part, f"{share(part)} of {of}", i if patterned else 0), shown(value), share(part)))
    made.append(("sum", "", shown(total), share(float(total > 0))))
    return Table(caption, (what, "", of, "share"), tuple(made), total=True)


def by_branch(columns: dict[str, dict[str, float]], caption: str, shown: Shown) -> Table:
    """Return what ``columns[heading][branch]`` hold, a row a branch, the last one their sum."""
    branches = list(next(iter(columns.values())))
    rows = [(words(branch), *(shown(found[branch]) for found in columns.values())) for branch in branches]
    rows.append(("sum", *(shown(sum(found.values())) for found in columns.values())))
    return Table(caption, ("branch", *columns), tuple(rows), total=True)


def by_class(rows: Sequence[Document], unit: str, caption: str, shown: Shown) -> Table:
    """Return a cost by class of the recordings."""
    most = max(row[f"max_{unit}"] for row in rows)
    return Table(
        caption,
        ("class", "", "recordings", "mean", "least", "most"),
        tuple(
            (
                count(row["class"]),
                Bar(row[f"mean_{unit}"] / most if most else 0.0, f"mean {shown(row[f'mean_{unit}'])}"),
                count(row["recordings"]),
                *(shown(row[f"{end}_{unit}"]) for end in ("mean", "min", "max")),
            )
            for row in rows
        ),
    )


def left_out(rows: Sequence[Document]) -> Table:
    """Return what the energy does not include, and the most that it can be where that is known."""
    return Table(
        "Not included in the energy",
        ("what", "at most", "by"),
        tuple(
            (
                row["what"],
                "not known" if row["at_most_pj"] is None else energy(row["at_most_pj"]),
                row["bound_source"] or NONE,
            )
            for row in rows
        ),
    )


def constants(name: str, profile: Document) -> Table:
    """Return each constant of a profile with its range and its source."""
    voltage = "voltage not stated" if profile["voltage_v"] is None else f"{profile['voltage_v']:g} V"
    rows = [
        (
            words(row["count"]),
            *(_constant(row[key], row[f"{key}_range"], unit) for key, unit in _OF_CONSTANTS.items()),
            row["source"],
        )
        for row in profile["constants"]
    ]
    barrier = profile["barrier_ns"]
    ends = f"{barrier['one_tile']:g} ns in one tile to {barrier['all_tiles']:g} ns in all"
    rows.append(("barrier, a step", NONE, ends, profile["source"]))
    return Table(
        f"Constants of profile {name}: {profile['basis']}; {voltage}",
        ("operation", "energy", "time", "source"),
        tuple(rows),
        folded=True,
    )


def _constant(value: float | None, ends: list[float | None] | None, unit: str) -> str:
    if value is None:
        return NONE
    if ends is None:
        return f"{value:g} {unit}"
    low, high = ends
    if low is None or high is None:
        return f"{'at most' if low is None else 'at least'} {value:g} {unit}"
    return f"{value:g} {unit} ({low:g} to {high:g})"
