"""The entry ``placed`` of report.json: an FPGA on which the open core was placed. ``locsnn rtl fit`` adds it."""

from collections.abc import Mapping

from locsnn_compile.report.figures.entries import Entry, IfKnown


class PlacedFigures(Entry):
    """``placed``: the open core of a target, placed on the FPGA (the device) of a board.

    Place and route is random, so it is run ``placements`` times; the fastest result is the bitstream.

    - ``core_mhz``: the clock that the board gives the core
    - ``used``, ``available``: cells of the device, by kind
    - ``fmax_mhz``, ``slowest_mhz``: the clocks that the fastest and the slowest placement reach; None
      where the core does not fit the device
    - ``placement``: the number of the fastest placement, from 1 on
    - ``lacking``: what the device has too little of; absent where the core fits
    """

    device: str
    board: str
    core_mhz: float
    used: Mapping[str, int]
    available: Mapping[str, int]
    fmax_mhz: float | None
    slowest_mhz: float | None
    placement: int | None
    placements: int
    lacking: IfKnown[str] = None

    @property
    def shares(self) -> dict[str, float]:
        """The share of each kind of cells that is used, the fullest kind first."""
        shares = {kind: self.used[kind] / cells for kind, cells in self.available.items() if cells}
        return dict(sorted(shares.items(), key=lambda kind_and_share: -kind_and_share[1]))

    @property
    def keeps_clock(self) -> bool:
        """Whether the bitstream can run at the clock that the board gives the core."""
        return self.fmax_mhz is not None and self.fmax_mhz >= self.core_mhz
