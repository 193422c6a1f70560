"""Find the dividers of a PLL that make the core's clock from the clock of a board.

All dividers that keep within the limits of the data sheet are tried. Frequencies are fractions, so
that a result is exact or is known to be off.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Protocol, TypeVar

from hw_model.errors import InputError
from hw_model.values import Frozen

TOLERANCE_HZ = 1
"""The largest difference from the wanted frequency. Files, and the advice of our own messages, give
MHz with six decimals, so a hertz is the best they can say."""


class Range(Frozen):
    """Frequencies in MHz, both ends included."""

    low: int
    high: int

    def holds(self, mhz: Fraction) -> bool:
        """Return whether a frequency is in the range."""
        return self.low <= mhz <= self.high

    @property
    def middle(self) -> Fraction:
        """The frequency in the middle."""
        return Fraction(self.low + self.high, 2)


# Timing of the sysCLOCK PLL in the data sheets of ECP5 (FPGA-DS-02012) and iCE40 UltraPlus
# (FPGA-DS-02008).
ECP5_DETECTOR = Range(low=10, high=400)
ECP5_OSCILLATOR = Range(low=400, high=800)
ECP5_OUTPUT = Range(low=4, high=400)
ECP5_DIVIDERS = range(1, 129)
"""Values of CLKI_DIV, of CLKOP_DIV, which feeds back (CLKFB_DIV is 1), and of CLKOS_DIV, the output."""
ICE40_DETECTOR = Range(low=10, high=133)
ICE40_OSCILLATOR = Range(low=533, high=1066)
ICE40_OUTPUT = Range(low=16, high=275)
ICE40_DIVR = range(16)
ICE40_DIVF = range(128)
ICE40_DIVQ = range(1, 7)
"""Values of the parameters of these names; the output is divided by 2 to the power of DIVQ."""
ICE40_FILTERS = ((17, 1), (26, 2), (44, 3), (66, 4), (101, 5), (133, 6))
"""The setting of the loop filter by the frequency at the phase detector: (highest MHz, setting)."""


class Ecp5Pll(Frozen):
    """EHXPLLL, fed back from an output of its own: input / ``reference`` * ``feedback`` / ``output``."""

    input_mhz: Fraction
    reference: int
    feedback: int
    output: int

    @property
    def oscillator_mhz(self) -> Fraction:
        """The frequency inside the PLL."""
        return self.input_mhz / self.reference * self.feedback

    @property
    def output_mhz(self) -> Fraction:
        """Frequency of the core."""
        return self.oscillator_mhz / self.output


class Ice40Pll(Frozen):
    """SB_PLL40 with simple feedback: input / (``divr`` + 1) * (``divf`` + 1) / 2^``divq``."""

    input_mhz: Fraction
    divr: int
    divf: int
    divq: int

    @property
    def detector_mhz(self) -> Fraction:
        """Frequency at the phase detector."""
        return self.input_mhz / (self.divr + 1)

    @property
    def oscillator_mhz(self) -> Fraction:
        """Frequency inside the PLL."""
        return self.detector_mhz * (self.divf + 1)

    @property
    def output_mhz(self) -> Fraction:
        """Frequency of the core."""
        return self.oscillator_mhz / (1 << self.divq)

    @property
    def filter_range(self) -> int:
        """Setting of the filter of the loop."""
        return next(
            setting for highest_mhz, setting in ICE40_FILTERS if self.detector_mhz <= highest_mhz
        )


class _Pll(Protocol):
    @property
    def oscillator_mhz(self) -> Fraction: ...
    @property
    def output_mhz(self) -> Fraction: ...


P = TypeVar("P", bound=_Pll)


def ecp5_pll(input_mhz: float, core_mhz: float, where: str) -> Ecp5Pll:
    """Return the dividers for a frequency; ``InputError``, which begins with ``where``, if none give it."""
    dividers = _ecp5_dividers(_exact(input_mhz))
    return _best(dividers, core_mhz, input_mhz, ECP5_OSCILLATOR, where)


def ice40_pll(input_mhz: float, core_mhz: float, where: str) -> Ice40Pll:
    """Return the dividers for a frequency; ``InputError``, which begins with ``where``, if none give it."""
    dividers = _ice40_dividers(_exact(input_mhz))
    return _best(dividers, core_mhz, input_mhz, ICE40_OSCILLATOR, where)


def _exact(mhz: float) -> Fraction:
    """Return a frequency exactly as it is written in decimals; the float only comes near to it."""
    return Fraction(repr(mhz))


def _ecp5_dividers(input_mhz: Fraction) -> Iterator[Ecp5Pll]:
    """Yield all settings of an ECP5's PLL that its limits allow."""
    # The feedback divider CLKOP_DIV alone is enough: the oscillator runs at up to 800 MHz, at most
    # 80 times the 10 MHz at the detector, and the divider goes up to 128.
    for reference in ECP5_DIVIDERS:
        if not ECP5_DETECTOR.holds(input_mhz / reference):
            continue
        for feedback in ECP5_DIVIDERS:
            if not ECP5_OSCILLATOR.holds(input_mhz / reference * feedback):
                continue
            for output in ECP5_DIVIDERS:
                pll = Ecp5Pll(input_mhz, reference, feedback, output)
                if ECP5_OUTPUT.holds(pll.output_mhz):
                    yield pll


def _ice40_dividers(input_mhz: Fraction) -> Iterator[Ice40Pll]:
    """Yield all settings of an iCE40's PLL that its limits allow."""
    for divr in ICE40_DIVR:
        if not ICE40_DETECTOR.holds(input_mhz / (divr + 1)):
            continue
        for divf in ICE40_DIVF:
            for divq in ICE40_DIVQ:
                pll = Ice40Pll(input_mhz, divr, divf, divq)
                if ICE40_OSCILLATOR.holds(pll.oscillator_mhz) and ICE40_OUTPUT.holds(
                    pll.output_mhz
                ):
                    yield pll


def _best(
    dividers: Iterable[P], core_mhz: float, input_mhz: float, oscillator: Range, where: str
) -> P:
    """Return the dividers whose output is nearest to a frequency.

    Of several that are as near, the one whose oscillator is furthest from its limits. Raise an
    ``InputError`` if there are none, or none near enough.
    """
    target = _exact(core_mhz)
    best = min(
        dividers,
        key=lambda pll: (
            abs(pll.output_mhz - target),
            abs(pll.oscillator_mhz - oscillator.middle),
        ),
        default=None,
    )
    what = f"the PLL cannot make {core_mhz:g} MHz from {input_mhz:g} MHz"
    if best is None:
        raise InputError(where, what, fix="Leave it out, to use the clock of the board.")
    off_hz = abs(best.output_mhz - target) * 1_000_000
    if off_hz > TOLERANCE_HZ:
        nearest = f"{float(best.output_mhz):.6f}".rstrip("0").rstrip(".")
        measured = f"the nearest is {nearest} MHz"
        raise InputError(where, what, measured=measured, fix=f"Give {nearest}.")
    return best
