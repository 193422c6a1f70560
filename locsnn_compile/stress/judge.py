"""The verdict of what was measured, and its causes in words."""

from __future__ import annotations

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
    defects = _defects(measured)
    if defects:
        return Row(case, "unexplained", defects, measured)
    causes = (*_overflows(measured), *_losses(measured), *_errors(case, measured), *_ties(measured))
    return Row(case, "limited" if causes else "ok", causes, measured)


def _defects(m: Measured) -> tuple[str, ...]:
    found = []
    if m.odd_engine:
        found.append(f"{m.odd_engine} differs from the fast engine")
    if m.outside:
        found.append(f"{plural(m.outside, 'potential')} lie beyond the bound of {short(m.bound)} thresholds")
    return tuple(found)


def _overflows(m: Measured) -> list[str]:
    found = []
    if m.wraps:
        found.append(f"{plural(m.wraps, 'wrap')}: a charge or current leaves its register")
    if m.clips:
        found.append(f"{plural(m.clips, 'clip')}: the potential leaves its register")
    if m.overflowed and not found:
        found.append(f"{plural(m.overflowed, 'potential')} would leave the register with the float network's spikes")
    return found


def _losses(m: Measured) -> list[str]:
    found = [
        f"{count(these.lost)} of {plural(these.of, word)} round to 0"
        if these.of > 1
        else f"the only {word} rounds to 0"
        for these, word in ((m.weights, "weight"), (m.biases, "bias"))
        if these.lost
    ]
    return [text.replace("biass", "biases") for text in found] + list(m.coarse_decays)


def _errors(case: Case, m: Measured) -> list[str]:
    """Name what moves the potential by more than a tenth of a threshold, wraps and clips aside."""
    found = []
    if m.model_error > TENTH:
        found.append(f"{_MODELS[case.strategy]}: {short(m.model_error)} thresholds at most")
    elif m.error > TENTH and not m.overflowed:
        found.append(f"rounding: {short(m.error)} thresholds found, at most {_parts(m)}")
    return found


def _parts(m: Measured) -> str:
    """Name the sources that a tenth of the bound, or more, is made of."""
    large = [source for source in SOURCES if m.parts[source] >= TENTH * m.bound]
    return " and ".join(f"{short(m.parts[source])} by {_ROUNDED[source]}" for source in large)


def _ties(m: Measured) -> list[str]:
    if not m.ties:
        return []
    return [f"{plural(m.ties, 'potential')} exactly at the threshold: the least rounding decides"]
