"""Entry of report.json on the device with the core placed on it, which ``locsnn rtl fit`` adds."""

from collections.abc import Mapping

from locsnn_compile.report.figures.entries import Entry, IfKnown


class PlacedFigures(Entry):
    """``placed``: the core of a target on a board.

    - ``core_mhz``: the clock that the board gives the core
    - ``used``, ``available``: cells of the device, by kind
    - ``fmax_mhz``: the clock that the bitstream reaches, which is of the fastest of ``placements``;
      ``slowest_mhz``: that of the slowest of them; None where the device has no room
    - ``placement``: the number of the fastest, from 1 on
    - ``lacking``: what the device has too little of
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
        """The share of each kind of cells that is used, the fullest first."""
        shares = {kind: self.used[kind] / cells for kind, cells in self.available.items() if cells}
        return dict(sorted(shares.items(), key=lambda pair: -pair[1]))

    @property
    def keeps_clock(self) -> bool:
        """Whether the bitstream reaches the clock of the board."""
        return self.fmax_mhz is not None and self.fmax_mhz >= self.core_mhz
