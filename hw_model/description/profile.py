"""Energy and time profiles: published sets of costs, each constant with its source, its range and its voltage."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Annotated, Any, Literal

from hw_model.io.records import Must, between
from hw_model.values import Frozen, Shown

_LARGEST = 1 << 40
"""Far above any cost or voltage of a chip. It keeps products with counts finite, and is chosen by hand."""
Range = tuple[
    Annotated[float | None, between(0, _LARGEST)], Annotated[float | None, between(0, _LARGEST)]
]
"""The least and the largest possible value of a constant; None if it is unknown."""
End = Literal["least", "most"]
"""An end of a range."""


Text = Annotated[str, Must(lambda text: 0 < len(text) <= 500, "of 1 to 500 characters")]
Cost = Annotated[float, between(0, _LARGEST)]


class Barrier(Frozen):
    """Time of the barrier in nanoseconds, for one tile and for all tiles of a chip.

    At the barrier, which ends every step, all cores of the mesh wait for each other.
    """

    one_tile: Cost
    all_tiles: Cost

    def ns(self, tiles: int, all_tiles: int) -> float:
        """Return the time for some tiles, interpolated linearly between the published values."""
        share = (tiles - 1) / max(all_tiles - 1, 1)
        return self.one_tile + share * (self.all_tiles - self.one_tile)


class StaticPower(Frozen):
    """The power that a whole chip draws whatever it does, in milliwatts."""

    chip_mw: Cost
    source: Text

    def pj(self, chips: int, ns: float) -> float:
        """Return the energy of some chips over a time: a milliwatt is a picojoule per nanosecond."""
        return self.chip_mw * chips * ns


class NotIncluded(Frozen):
    """Something that a profile does not price, with an upper bound of its energy if one is known.

    The bound is the sum of ``bound_pj``, picojoules for each unit of a count, and
    ``bound_recording_pj`` for every recording.
    """

    what: Text
    bound_pj: Mapping[str, Cost] = field(default_factory=dict)
    bound_source: str = ""
    bound_recording_pj: Cost = 0.0

    @staticmethod
    def from_plain(value: Any) -> Any:
        """Return the mapping that a plain text in a file stands for: something without a bound."""
        return {"what": value} if isinstance(value, str) else value


class Profile(Shown, eq=True):
    """One published set of costs: picojoules and nanoseconds for each count that it prices.

    ``source`` names the publication, and ``basis`` how the costs were found, such as by simulation or measurement.

    ``energy_pj_range`` and ``time_ns_range`` hold the ranges of constants for which the source gives a least value, a
    largest value or both. ``sources`` names the other sources of single constants. ``voltage_v`` is the supply voltage
    at which the costs hold; None if it is not stated.
    """

    source: Text
    basis: Text
    energy_pj: Mapping[str, Cost]
    time_ns: Mapping[str, Cost]
    barrier_ns: Barrier
    not_included: tuple[NotIncluded, ...]
    voltage_v: Annotated[float | None, between(0, _LARGEST)] = None
    energy_pj_range: Mapping[str, Range] = field(default_factory=dict)
    time_ns_range: Mapping[str, Range] = field(default_factory=dict)
    sources: Mapping[str, Text] = field(default_factory=dict)
    static_power: StaticPower | None = None

    def source_of(self, count: str) -> str:
        """Return the source of one constant."""
        return self.sources.get(count, self.source)

    def with_times(self, end: End) -> "Profile | None":
        """Return the profile with all times at one end of their ranges; None if one is unknown."""
        index = 1 if end == "most" else 0
        ends = {name: time_range[index] for name, time_range in self.time_ns_range.items()}
        if None in ends.values():
            return None
        return replace(self, time_ns={**self.time_ns, **ends}, time_ns_range={})  # type: ignore[dict-item]


UNPRICED = Profile(
    source="no power model of such devices is public",
    basis="cycle-exact model of the RTL core at the placed clock",
    energy_pj={},
    time_ns={},
    barrier_ns=Barrier(one_tile=0.0, all_tiles=0.0),
    not_included=(),
)
"""The profile of an open core without one: its clock cycles are counted, and nothing is priced."""
