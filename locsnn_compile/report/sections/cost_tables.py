"""What energy and time have in common: spread, breakdowns, course over the steps, and constants with sources."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from hw_model.values import Frozen
from locsnn_compile.report.content import Bar, Curve, Document, Fact, Plot, Span, Stack, Table
from locsnn_compile.report.format import NONE, count, energy, share, time
from locsnn_compile.report.pictures.axis import Axis, round_numbers
from locsnn_compile.report.words import share_of, table, words

Shown = Callable[[float], str]
_OF_CONSTANTS = {"energy_pj": "pJ", "time_ns": "ns"}
PARTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of all steps after which a table gives a figure."""


class Cost(Frozen):
    """Energy or time: its name, its entry in the document, the unit in the keys there, and how it is shown."""

    name: str
    key: str
    unit: str
    shown: Shown

    def span(self, document: Document) -> Span:
        """Return the spread over the recordings."""
        found = document[self.key]
        spread = found[f"over_samples_{self.unit}"]
        ends = {"least": spread["min"], "median": spread["p50"]}
        ends |= {"mean": found[f"per_sample_{self.unit}"], "most": spread["max"]}
        facts = tuple(Fact(label, self.shown(value)) for label, value in ends.items())
        return Span(f"{self.name} per recording{_by(found)}", facts, tuple(ends.values()))

    def facts(self, document: Document) -> dict[str, str]:
        """Return the range of the mean and the costliest recordings in words."""
        found = document[self.key]
        worst = found["worst_recording"]
        label = (
            "" if worst["class"] is None else f" of class {_class_name(document, worst['class'])}"
        )
        return {
            "range": _range(found[f"range_{self.unit}"], self.shown),
            "p99": f"at most {self.shown(found[f'over_samples_{self.unit}']['p99'])}",
            "worst": f"recording {worst['recording']}{label}, {self.shown(worst[self.unit])}",
        }

    def by_class(self, document: Document) -> Table | None:
        """Return a table by class; None if the recordings have no labels."""
        found = document[self.key]
        rows = found["by_class"]
        if not rows:
            return None
        largest = max(row[f"max_{self.unit}"] for row in rows)
        shown = {}
        for row in rows:
            ends = {end: self.shown(row[f"{end}_{self.unit}"]) for end in ("mean", "min", "max")}
            drawn = share_of(row[f"mean_{self.unit}"], largest)
            shown[_class_name(document, row["class"])] = {
                "recordings": row["recordings"],
                "drawn": drawn,
                **ends,
            }
        return table("classes", shown, cost=self.name, by=_by(found))

    def course(self, document: Document) -> tuple[Plot, Table]:
        """Draw each bin's mean at its middle, and return a table as well."""
        found = document[self.key]
        by_step, of_profile = found[f"by_step_{self.unit}"], f"profile {found['profile']}"
        a_step = {branch: _per_step(its) for branch, its in by_step.items()}
        most = max((value for values in a_step.values() for value in values), default=0.0) or 1.0
        curves = tuple(
            Curve(
                words(name),
                tuple(((i + 0.5) / len(by_step[name]["bins"]), x) for i, x in enumerate(values)),
            )
            for name, values in a_step.items()
        )
        return (
            Plot(
                title=f"{self.name} of a step, mean over the recordings, {of_profile}",
                x_label="part of the branch's steps",
                x=Axis(0.0, 1.0, (0.0, *PARTS), lambda part: f"{100 * part:.0f} %"),
                y=Axis(0.0, most, tuple(x for x in round_numbers(0.0, most, 4) if x), self.shown),
                curves=curves,
            ),
            Table(
                f"{self.name} after a part of the steps, mean per recording, {of_profile}",
                ("branch", *(f"{100 * part:.0f} % of its steps" for part in PARTS)),
                tuple(
                    (words(branch), *self._so_far(its["bins"])) for branch, its in by_step.items()
                ),
            ),
        )

    def _so_far(self, bins: Sequence[float]) -> list[str]:
        return [self.shown(sum(bins[: round(part * len(bins))])) for part in PARTS]


def _per_step(course: Document) -> list[float]:
    """Return the mean of a step in each bin, without a last bin that may have fewer steps."""
    bins, steps = course["bins"], course["bin_steps"]
    return [value / steps for value in (bins[:-1] if steps > 1 else bins) or bins]


def _by(found: Document) -> str:
    return f", profile {found['profile']}" if found["profile"] else ""


ENERGY = Cost("Energy", "energy", "pj", energy)
TIME = Cost("Time", "latency", "ns", time)


def stack(breakdown: dict[str, float], label: str) -> Stack:
    """Return parts of an energy as one bar."""
    total = sum(breakdown.values())
    parts = [
        (words(name), share_of(pj, total), i)
        for i, (name, pj) in enumerate(breakdown.items())
        if pj
    ]
    return Stack(label, tuple(Bar(its, f"{name} {share(its)}", i) for name, its, i in parts))


def shares(
    what: str, caption: str, parts: Iterable[tuple[str, float]], *, patterned: bool = False
) -> Table:
    """Return a table of parts of an energy with their sum; ``what`` heads the column of their names."""
    rows = list(parts)
    total = sum(value for _, value in rows)
    made: list[tuple[str | Bar, ...]] = []
    for i, (name, value) in enumerate(rows):
        its = share(share_of(value, total))
        made.append(
            (
                name,
                Bar(share_of(value, total), f"{its} of energy", i if patterned else 0),
                energy(value),
                its,
            )
        )
    made.append(("sum", "", energy(total), share(float(total > 0))))
    return Table(caption, (what, "", "energy", "share"), tuple(made), total=True)


def by_branch(columns: dict[str, dict[str, float]], caption: str, shown: Shown) -> Table:
    """Return ``columns[heading][branch]`` as a table: a row per branch, and the sum as the last row."""
    branches = list(next(iter(columns.values())))
    rows = [
        (words(branch), *(shown(found[branch]) for found in columns.values()))
        for branch in branches
    ]
    rows.append(("sum", *(shown(sum(found.values())) for found in columns.values())))
    return Table(caption, ("branch", *columns), tuple(rows), total=True)


def constants(name: str, profile: Document) -> Table:
    """Return a table of the constants of a profile with their ranges and sources."""
    voltage = (
        "voltage not stated" if profile["voltage_v"] is None else f"{profile['voltage_v']:g} V"
    )
    rows = [
        row
        | {
            key: _constant(row[key], row[f"{key}_range"], unit)
            for key, unit in _OF_CONSTANTS.items()
        }
        for row in profile["constants"]
    ]
    ends = "{one_tile:g} ns in one tile to {all_tiles:g} ns in all".format(**profile["barrier_ns"])
    barrier = {
        "count": "barrier, per step",
        "energy_pj": NONE,
        "time_ns": ends,
        "source": profile["source"],
    }
    return table(
        "constants",
        [*rows, barrier],
        folded=True,
        profile=name,
        basis=profile["basis"],
        voltage=voltage,
    )


def _range(ends: Sequence[Any], shown: Shown) -> str:
    """Return the range of a mean in words; None is an unknown end."""
    low, high = ends
    if low is None and high is None:
        return "not known"
    if low is None:
        return f"{shown(high)} or less: a constant is given as an upper bound"
    if high is None:
        return f"{shown(low)} or more: a constant is given as a lower bound"
    return (
        "none: no constant is given as a range" if low == high else f"{shown(low)} to {shown(high)}"
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


def _class_name(document: Document, number: int) -> str:
    """Return the name of a class, or else its number."""
    names = document.get("classes")
    return names[number] if names else count(number)
