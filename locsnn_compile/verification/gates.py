"""Gates: bounds that a build must keep, checked against its report, and written for a CI server as JUnit XML."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

from hw_model.io.xml_text import xml_file, xml_text

Report = Mapping[str, Any]


class Gate(NamedTuple):
    """An option's bound and what was measured, None where nothing was compared; ``found`` is a line without its end."""

    option: str
    bound: float
    measured: float | None
    holds: bool
    found: str


class _Rule(NamedTuple):
    option: str
    measure: Callable[[Report], float | None]
    text: str
    """What was measured; ``{}`` is the value."""
    at_least: bool = False
    unknown: str = "it was not measured"
    """Why there is no value."""


_RULES = (
    _Rule(
        "--min-agreement",
        lambda r: r["match"]["prediction_agreement"],
        "prediction agreement is {:.4f}",
        at_least=True,
        unknown="no prediction was compared, as all class scores tie in every recording",
    ),
    _Rule(
        "--max-spike-error",
        lambda r: None if (equal := r["match"]["spike_agreement"]) is None else 1 - equal,
        "{:.4f} of the spikes differ",
        unknown="no spike was compared, as no neuron spiked",
    ),
    _Rule(
        "--max-energy-nj",
        lambda r: None if (pj := r["energy"]["per_sample_pj"]) is None else pj / 1000,
        "a recording takes {:.1f} nJ",
        unknown="the energy of this target is not known",
    ),
    _Rule("--max-latency-us", lambda r: r["latency"]["per_sample_ns"] / 1000, "a recording takes {:.1f} µs"),
    _Rule("--max-cores", lambda r: r["resources"]["cores"], "{} cores are used"),
)
GATES = tuple(rule.option for rule in _RULES)


def check_gates(report: Report, bounds: Mapping[str, float]) -> tuple[Gate, ...]:
    """Return a gate for each bound by option, in the order of :data:`GATES`; one on what was not measured fails."""
    return tuple(_gate(rule, rule.measure(report), bounds[rule.option]) for rule in _RULES if rule.option in bounds)


def _gate(rule: _Rule, value: float | None, bound: float) -> Gate:
    if value is None:
        return Gate(rule.option, bound, None, False, rule.unknown)
    holds = value >= bound if rule.at_least else value <= bound
    side = ("not below" if holds else "below") if rule.at_least else ("not above" if holds else "above")
    return Gate(rule.option, bound, value, holds, f"{rule.text.format(value)}, {side} {bound:g}")


def gates_entry(gates: Sequence[Gate]) -> list[dict[str, Any]]:
    """Return ``gates`` of report.json."""
    return [
        {"name": gate.option, "bound": gate.bound, "measured": gate.measured, "passed": gate.holds} for gate in gates
    ]


def junit_file(gates: Sequence[Gate], build: str) -> bytes:
    """Return JUnit XML: a test case a gate, of the class ``build``; without times, so equal builds give equal bytes."""
    failures = str(sum(not gate.holds for gate in gates))
    counts = {"tests": str(len(gates)), "failures": failures, "errors": "0", "skipped": "0", "time": "0"}
    root = ElementTree.Element("testsuites", {"name": "locsnn-compile", **counts})
    suite = ElementTree.SubElement(root, "testsuite", {"name": "gates", **counts})
    for gate in gates:
        about = {"classname": xml_text(build), "name": gate.option, "time": "0"}
        case = ElementTree.SubElement(suite, "testcase", about)
        if gate.holds:
            ElementTree.SubElement(case, "system-out").text = gate.found
        else:
            ElementTree.SubElement(case, "failure", {"type": "gate", "message": gate.found}).text = gate.found
    return xml_file(root)
