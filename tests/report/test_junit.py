"""The results of gates as JUnit XML, compared with a file written out by hand."""

from __future__ import annotations

from locsnn_compile.report.gates import Gate, junit_file


def test_gates_are_test_cases_of_a_build() -> None:
    gates = (
        Gate(
            "--max-cores",
            bound=2.0,
            measured=1.0,
            holds=True,
            found="the program takes 1 core, not above 2",
        ),
        Gate(
            "--min-agreement",
            bound=1.0,
            measured=None,
            holds=False,
            found='no "prediction"\x00 was compared & judged',
        ),
    )
    assert junit_file(gates, "a<b").decode() == (
        "<?xml version='1.0' encoding='utf-8'?>\n"
        '<testsuites name="locsnn-compile" tests="2" failures="1" errors="0" skipped="0" time="0">\n'
        '  <testsuite name="gates" tests="2" failures="1" errors="0" skipped="0" time="0">\n'
        '    <testcase classname="a&lt;b" name="--max-cores" time="0">\n'
        "      <system-out>the program takes 1 core, not above 2</system-out>\n"
        "    </testcase>\n"
        '    <testcase classname="a&lt;b" name="--min-agreement" time="0">\n'
        '      <failure type="gate" message="no &quot;prediction&quot;\ufffd was compared &amp; judged">'
        'no "prediction"\ufffd was compared &amp; judged</failure>\n'
        "    </testcase>\n"
        "  </testsuite>\n"
        "</testsuites>\n"
    )
