"""Probes of chosen populations and steps return the same part of what probes of everything return, and nothing else."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.simulation import ENGINES
from tests.support.random_programs import SMALL, random_program


@pytest.fixture(scope="module")
def example():
    """A program, a recording, and the result with probes of everything."""
    program, _, _, spikes = random_program(7, SMALL)
    return program, spikes, hw.simulate(program, spikes, probe=("spikes", "u", "v", "potential"))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", ["spikes", "u", "v", "potential"])
@pytest.mark.parametrize(
    ("populations", "steps"),
    [
        (None, None),
        (("h",), None),
        (None, range(5, 9)),
        (("h/dendrite", "y"), range(38, 60)),
        (("y",), range(50, 60)),
    ],
    ids=["all", "one", "some steps", "both", "after the end"],
)
def test_a_probe_returns_its_part_of_the_full_result(example, engine, kind, populations, steps):
    program, spikes, full_result = example
    result = hw.simulate(
        program, spikes, engine=engine, probe=(hw.Probe(kind, populations, steps),)
    )
    expected = {
        name: array
        for name, array in getattr(full_result, kind).items()
        if populations is None or name in populations
    }
    rows = slice(None) if steps is None else slice(steps.start, steps.stop)
    assert getattr(result, kind).keys() == expected.keys()
    for name, array in expected.items():
        assert np.array_equal(getattr(result, kind)[name], array[rows])
    for kind_not_probed in {"spikes", "u", "v", "potential"} - {kind}:
        assert getattr(result, kind_not_probed) == {}


@pytest.mark.parametrize(
    ("probe", "message"),
    [
        (
            ("voltage",),
            "probe 'voltage': does not exist. Choose one of: activity, potential, spikes, u, v.",
        ),
        (("u", hw.Probe("u")), "probe 'u': is asked for twice. List its populations in one probe."),
        (
            (hw.Probe("v", ("h/dendrit",)),),
            "probe 'v': there is no 'h/dendrit'. Did you mean 'h/dendrite'?",
        ),
        (
            (hw.Probe("v", None, range(0, 8, 2)),),
            "probe 'v': steps must count up by one from 0 or later. Give a range.",
        ),
    ],
    ids=["kind", "twice", "population", "steps"],
)
def test_mistakes_in_probes_are_refused_with_their_way_out(example, probe, message):
    program, spikes, _ = example
    with pytest.raises(hw.InputError) as caught:
        hw.simulate(program, spikes, probe=probe)
    assert str(caught.value) == message
