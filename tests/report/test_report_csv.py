"""``--emit csv``: rows written out by hand for the small report, and cells that a spreadsheet must not run as formulas."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from locsnn_compile.report.renderers.csv_files import csv_files
from locsnn_compile.verification.excerpt import Excerpt


def _lines(files: dict[str, bytes], name: str) -> list[str]:
    """Return the lines of a table, by its name."""
    return files[f"csv/{name}.csv"].decode().splitlines()


def test_figures_have_their_units(document: dict[str, Any]) -> None:
    files = csv_files(document, excerpt=None)
    assert list(files) == ["csv/figures.csv"]
    lines = _lines(files, "figures")
    assert lines[0] == "section,name,unit,value"
    for line in (
        "model,name,,two-branches",
        "weight_bits,,bit,8",
        "match,first_divergence.step,,41",
        "energy,breakdown_pj.synaptic_ops,pJ,60000.0",
        "energy,over_samples_pj.p50,pJ,90000.0",
        "latency,per_sample_cycles,cycles,1400000",
        'energy,source,,"Davies et al., IEEE Micro 38(1), 2018, Table 2"',
    ):
        assert line in lines


def test_spikes_and_potentials_are_those_of_the_excerpt(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    files = csv_files(document, excerpt)
    assert _lines(files, "spikes") == [
        "axis,source,step,row,reference,chip",
        *(f"time,input,{step},0,1,1" for step in range(39, 43)),
        "time,time_output,39,1,1,1",
        "time,time_output,40,3,1,1",
        "time,time_output,41,3,1,0",
        "time,time_output,42,1,1,1",
        "time,time_output,42,3,0,1",
    ]
    assert _lines(files, "potential") == [
        "population,neuron,step,reference,chip,threshold,reference_spike,chip_spike",
        "time_output,3,39,4.0,4.0,10.0,0,0",
        "time_output,3,40,10.5,10.5,10.0,1,1",
        "time_output,3,41,10.25,9.75,10.0,1,0",
        "time_output,3,42,2.0,12.0,10.0,0,1",
    ]


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@sum", "\t=1"])
def test_no_text_is_a_formula(document: dict[str, Any], excerpt: Excerpt, name: str) -> None:
    excerpt = replace(excerpt, inputs=(replace(excerpt.inputs[0], name=name),))
    # A tab is shown as an escape, which begins with a backslash; all others get an apostrophe in front.
    cell = name.replace("\t", "\\t") if name[0] == "\t" else f"'{name}"
    assert _lines(csv_files(document, excerpt), "spikes")[1] == f"time,{cell},39,0,1,1"
