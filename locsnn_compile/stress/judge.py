"""The verdict of what was measured, and its causes in words."""

from __future__ import annotations

from collections.abc import Iterator

from locsnn_compile.report.format import count, plural, short
from locsnn_compile.stress.bounds import SOURCES, Source
from locsnn_compile.stress.cases.case import Case
from locsnn_compile.stress.row import TENTH, Measured, Row

_ROUNDED: dict[Source, str] = {"weights": "weights", "decays": "decays", "states": "truncation of states"}
_MODELS = {
    "reset": "its reset is another neuron model",
    "delay-line": "its taps are too few for what they leave in the input's filter",
}


def judge(case: Case, measured: Measured) -> Row:
    """Return the row of a case that the chip holds."""
    defects, causes = tuple(_defects(measured)), tuple(_causes(case, measured))
    if defects:
        return Row(case, "unexplained", defects, measured)
    return Row(case, "limited" if causes else "ok", causes, measured)


def _defects(m: Measured) -> Iterator[str]:
    if m.odd_engine:
        yield f"{m.odd_engine} differs from the fast engine"
    if m.outside:
        yield f"{plural(m.outside, 'potential')} lie beyond the bound of {short(m.bound_thresholds)} thresholds"


def _causes(case: Case, m: Measured) -> Iterator[str]:
    """Name what overflows, what is lost, and what else moves a potential by more than a tenth of a threshold."""
    if m.wraps:
        yield f"{plural(m.wraps, 'wrap')}: a charge or current leaves its register"
    if m.clips:
        yield f"{plural(m.clips, 'clip')}: the potential leaves its register"
    if m.overflowed and not (m.wraps or m.clips):
        yield f"{plural(m.overflowed, 'potential')} would leave the register with the float network's spikes"
    for these, one, many in ((m.weights, "weight", "weights"), (m.biases, "bias", "biases")):
        if these.lost:
            some = f"{count(these.lost)} of {plural(these.of, one, many)} round to 0"
            yield some if these.of > 1 else f"the only {one} rounds to 0"
    yield from m.coarse_decays
    if m.model_error_thresholds > TENTH:
        yield f"{_MODELS[case.strategy]}: {short(m.model_error_thresholds)} thresholds at most"
    elif m.error_thresholds > TENTH and not m.overflowed:
        # Of the bound, the sources that make up a tenth or more.
        large = [source for source in SOURCES if m.bound_parts_thresholds[source] >= TENTH * m.bound_thresholds]
        parts = " and ".join(f"{short(m.bound_parts_thresholds[source])} by {_ROUNDED[source]}" for source in large)
        yield f"rounding: {short(m.error_thresholds)} thresholds found, at most {parts}"
    if m.of_these_ties:
        yield f"{plural(m.of_these_ties, 'potential')} exactly at the threshold: the least rounding decides"
