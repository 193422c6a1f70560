"""Check the gates of a build: bounds on the figures of its report that the user sets as options.

``locsnn build --min-agreement 0.98`` ends with exit code 3 if a gate fails. The results also go into
report.json and, for CI servers, into a file of JUnit XML.

Gates read :class:`SharedFigures`: those figures that the reports of all kinds of chips have (mesh, open
core, Xylo, SpiNNaker), so that one gate serves all of them.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from hw_model.io.xml_text import escaped, xml_file
from hw_model.values import Frozen
from locsnn_compile.report.figures.document import GateFigures, SharedFigures
from locsnn_compile.report.format import plural
from locsnn_compile.verification.error_bounds import within


class Gate(NamedTuple):
    """The result of a gate.

    - ``option``: its option on the command line, and ``bound`` the user's value of it
    - ``measured``: the figure of the report; None if nothing was measured
    - ``holds``: whether the figure keeps the bound
    - ``found``: a sentence that says what was measured, and on which side of the bound it lies
    """

    option: str
    bound: float
    measured: float | None
    holds: bool
    found: str


class _Rule(Frozen):
    """A figure of the report that an option bounds.

    - ``measured``: returns the figure of a report, None if the report has none
    - ``in_words``: returns the figure in words
    - ``why_unknown``: the words for a report without the figure
    - ``at_least``: whether the bound is a lower one, which the figure must not be below, as an agreement;
      otherwise it is an upper one, which the figure must not be above, as an error or a cost
    """

    option: str
    measured: Callable[[SharedFigures], float | None]
    in_words: Callable[[float], str]
    why_unknown: str
    at_least: bool = False


def _spike_error(report: SharedFigures) -> float | None:
    """Return the share of spikes that differ, over all recordings of the check."""
    agreement = report.match.spikes.spike_agreement
    return None if agreement is None else 1 - agreement


def _energy_nj(report: SharedFigures) -> float | None:
    """Return the mean energy per recording."""
    return None if report.energy_pj is None else report.energy_pj / 1000


def _latency_us(report: SharedFigures) -> float | None:
    """Return the mean time per recording."""
    return None if report.latency_ns is None else report.latency_ns / 1000


# Energy and latency are means over the recordings. The spread of class scores is the mean distance of a
# score of the network from the mean of all its scores in that recording.
_RULES = (
    _Rule(
        "--min-agreement",
        lambda report: report.match.prediction_agreement,
        "prediction agreement is {:.4f}".format,
        "no prediction was compared, as all class scores tie in every recording",
        at_least=True,
    ),
    _Rule(
        "--max-spike-error",
        _spike_error,
        "{:.4f} of the spikes differ".format,
        "no spike was compared, as no neuron spiked",
    ),
    _Rule(
        "--max-score-error",
        lambda report: report.match.score_error,
        "class scores differ by {:.4f} of their spread".format,
        "no class score was compared, as all scores of the network tie in every recording",
    ),
    _Rule(
        "--max-energy-nj",
        _energy_nj,
        "a recording takes {:.1f} nJ".format,
        "the energy of this target is not known",
    ),
    _Rule(
        "--max-latency-us",
        _latency_us,
        "a recording takes {:.1f} µs".format,
        "the latency is not known, as the profile has no times of operations",
    ),
    _Rule(
        "--max-cores",
        lambda report: report.resources.cores,
        lambda cores: f"the program takes {plural(cores, 'core')}",
        "the cores are not known",
    ),
)
GATES: tuple[str, ...] = tuple(rule.option for rule in _RULES)
"""The options that are gates, in the order in which their results are listed."""


def check_gates(report: SharedFigures, bounds: Mapping[str, float]) -> tuple[Gate, ...]:
    """Return the result of each option in ``bounds``, in the order of :data:`GATES`.

    A gate without a measured value fails: a build that compared nothing has not shown that it is good.
    """
    return tuple(
        _gate(rule, report, bounds[rule.option]) for rule in _RULES if rule.option in bounds
    )


def _gate(rule: _Rule, report: SharedFigures, bound: float) -> Gate:
    """Return the result of one rule; an unknown value fails."""
    measured = rule.measured(report)
    if measured is None:
        return Gate(rule.option, bound, measured=None, holds=False, found=rule.why_unknown)
    if rule.at_least:
        # Exact: an agreement is a count divided by a count, and 98 / 100 is the float that 0.98 is read as.
        holds = measured >= bound
        side = "not below" if holds else "below"
    else:
        # An error is computed as 1 minus an agreement, which leaves an error of rounding: in floats,
        # 1 - 0.99 is above 0.01. ``within`` forgives that.
        holds = within(measured, bound)
        side = "not above" if holds else "above"
    sentence = f"{rule.in_words(measured)}, {side} {bound:g}"
    return Gate(rule.option, bound, measured, holds, sentence)


def gates_entry(gates: Sequence[Gate]) -> tuple[GateFigures, ...]:
    """Return ``gates`` of report.json."""
    return tuple(GateFigures(gate.option, gate.bound, gate.measured, gate.holds) for gate in gates)


def junit_file(gates: Sequence[Gate], build: str) -> bytes:
    """Return JUnit XML with a test case per gate, whose class is the name of the build.

    All times are 0, so that equal builds give equal bytes.
    """
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
    """Return a gate as an element of JUnit XML."""
    sentence = escaped(gate.found)
    if gate.holds:
        result = f"<system-out>{sentence}</system-out>"
    else:
        result = f'<failure type="gate" message="{sentence}">{sentence}</failure>'
    return (
        f'<testcase classname="{escaped(build)}" name="{escaped(gate.option)}" time="0">'
        f"{result}</testcase>"
    )
