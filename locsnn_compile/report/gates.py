"""Gates: bounds that a build must keep, checked against its report, and written as JUnit XML for CI servers."""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any, NamedTuple

from hw_model.io.xml_text import escaped, xml_file
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.document import GateFigures
from locsnn_compile.report.words import fill, texts
from locsnn_compile.verification.error_bounds import within


class Gate(NamedTuple):
    """An option's bound and the value measured, None if nothing was compared; ``found`` says it in words."""

    option: str
    bound: float
    measured: float | None
    holds: bool
    found: str


GATES: tuple[str, ...] = tuple(texts("gates"))


def check_gates(report: Document, bounds: Mapping[str, float]) -> tuple[Gate, ...]:
    """Return a gate for each bound by option, in the order of :data:`GATES`; without a measured value it fails."""
    return tuple(_gate(option, report, bounds[option]) for option in GATES if option in bounds)


def _gate(option: str, report: Document, bound: float) -> Gate:
    rule = texts("gates", option)
    found: list[Any] = [
        reduce(getitem, rule[key].split("."), report) for key in ("figure", "needs") if key in rule
    ]
    if (value := found[0]) is None or False in found[1:]:
        return Gate(option, bound, None, False, rule["unknown"])
    value = (
        rule["whole"] - value
        if "whole" in rule
        else value / rule["per"]
        if "per" in rule
        else value
    )
    at_least = "at_least" in rule
    holds = value >= bound if at_least else within(value, bound)
    side = ("not below" if holds else "below") if at_least else ("not above" if holds else "above")
    return Gate(
        option, bound, value, holds, f"{fill(rule['said'], {'value': value})}, {side} {bound:g}"
    )


def gates_entry(gates: Sequence[Gate]) -> tuple[GateFigures, ...]:
    """Return ``gates`` of report.json."""
    return tuple(GateFigures(gate.option, gate.bound, gate.measured, gate.holds) for gate in gates)


def junit_file(gates: Sequence[Gate], build: str) -> bytes:
    """Return JUnit XML: a test case per gate, of class ``build``; it has no times, so equal builds give equal bytes."""
    failures = sum(not gate.holds for gate in gates)
    counts = f'tests="{len(gates)}" failures="{failures}" errors="0" skipped="0" time="0"'
    cases = "".join(_test_case(gate, build) for gate in gates)
    return xml_file(
        f"""\
<testsuites name="locsnn-compile" {counts}>
<testsuite name="gates" {counts}>{cases}</testsuite>
</testsuites>"""
    )


def _test_case(gate: Gate, build: str) -> str:
    said = escaped(gate.found)
    if gate.holds:
        result = f"<system-out>{said}</system-out>"
    else:
        result = f'<failure type="gate" message="{said}">{said}</failure>'
    return (
        f'<testcase classname="{escaped(build)}" name="{escaped(gate.option)}" time="0">'
        f"{result}</testcase>"
    )
