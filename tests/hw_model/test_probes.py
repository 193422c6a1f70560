"""Probes of chosen populations and steps keep what the full probes show, and nothing else."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.simulation import ENGINES
from tests.support.random_programs import SMALL, random_program


@pytest.fixture(scope="module")
def example():
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
def test_a_window_is_a_part_of_the_whole(example, engine, kind, populations, steps):
    program, spikes, whole = example
    result = hw.simulate(
        program, spikes, engine=engine, probe=(hw.Probe(kind, populations, steps),)
    )
    everything = getattr(whole, kind)
    expected = {n: a for n, a in everything.items() if populations is None or n in populations}
    rows = slice(None) if steps is None else slice(steps.start, steps.stop)
    assert getattr(result, kind).keys() == expected.keys()
    for name, array in expected.items():
        assert np.array_equal(getattr(result, kind)[name], array[rows])
    for other in {"spikes", "u", "v", "potential"} - {kind}:
        assert getattr(result, other) == {}


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
def test_probes_that_are_refused(example, probe, message):
    program, spikes, _ = example
    with pytest.raises(hw.InputError) as caught:
        hw.simulate(program, spikes, probe=probe)
    assert str(caught.value) == message
