"""The Python API: public types can be imported and print in a line, networks by hand, compiled folders, notebooks."""

from __future__ import annotations

import inspect
import json
import typing
from dataclasses import is_dataclass, replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import Shown
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.typed import typed
from tests.support.networks import hybrid, recordings

PUBLIC = {name: getattr(package, name) for package in (hw, lc) for name in package.__all__}
NEURON = {"decay_v": 0.1, "threshold": 1.0}


def by_hand(**changes):
    """Return a network of four channels, three hidden neurons and two outputs, with some fields changed."""
    network = lc.Network(
        name="by-hand",
        channels=4,
        steps=12,
        views=(lc.InputView("touch", "time", 4),),
        populations=(
            lc.Population("hidden", "time", 3, lc.Cuba.of(3, **NEURON)),
            lc.Population("scores", "time", 2, lc.Cuba.of(2, **NEURON)),
        ),
        projections=(
            lc.Projection("touch", "hidden", [[0.9, 0.1, 0.2, 0.3]] * 3),
            lc.Projection("hidden", "scores", np.full((2, 3), 0.8, dtype=np.float32)),
        ),
        readout=lc.Readout(("scores",), (1.0,)),
    )
    return replace(network, **changes)


@pytest.fixture(scope="module")
def compiled():
    """A small hybrid whose weights of 30 make many spikes, checked on labelled recordings of many events."""
    network = hybrid(scale=30.0)
    return lc.compile(network, events=recordings(network, rate=0.6), labels=[0, 1, 0])


def test_a_target_may_be_a_chip(compiled):
    network = compiled.network
    events = recordings(network, rate=0.6)
    for_chip = lc.compile(
        network, hw.chip("loihi-sim"), events=events, labels=compiled.match.labels
    )
    assert for_chip.files() == compiled.files()


@pytest.fixture(scope="module")
def values(compiled):
    """A value of every public type that holds large arrays or many parts."""
    spikes = recordings(compiled.network)
    result = hw.simulate(compiled.program, spikes)
    program = compiled.program
    return {
        "CompiledModel": compiled,
        "Network": compiled.network,
        "InputView": compiled.network.views[1],
        "Population": compiled.network.populations[0],
        "Projection": compiled.network.projections[0],
        "Cuba": lc.Cuba.of(500, **NEURON),
        "ChipCuba": lc.ChipCuba.of(500, decay_u=1, decay_v=2, threshold=3),
        "Levels": compiled.levels,
        "Match": compiled.match,
        "Choice": compiled.choice,
        "Excerpt": compiled.excerpt,
        "Diagnosis": lc.diagnose(compiled, spikes),
        "Recordings": Recordings(spikes, labels=None, step_seconds=None, source="array"),
        "TrainingConfig": lc.TrainingConfig(epochs=3),
        "ErrorBudget": lc.ErrorBudget(0.5),
        "Chip": program.chip,
        "ChipProgram": program,
        "SimulationResult": result,
        "Profile": program.chip.profile("davies2018"),
        "StepScores": hw.Session(program).push(spikes[0]),
        "Stops": hw.stop_when_proven(program, spikes),
        "ProgramBuilder": hw.ProgramBuilder(program.chip),
        "Session": hw.Session(program),
        "Latency": compiled.match.latencies[0],
        "CoreRange": hw.prove_range(program)[0],
        "WorstCase": hw.worst_case(program, spikes.shape[1], 1),
    }


def test_every_public_value_prints_in_a_line(values):
    for name, value in values.items():
        assert type(value).__name__ == name
        assert len(repr(value)) <= 450, name
        assert "\n" not in repr(value), name


def test_only_small_public_types_print_all_their_fields():
    """All other dataclasses print by ``Shown``, which shortens arrays and parts."""
    with_all_fields = {
        name
        for name, kind in PUBLIC.items()
        if is_dataclass(kind) and kind.__repr__ is not Shown.__repr__
    }
    assert with_all_fields == {
        "CompiledModel",
        "CompiledSpinnaker",
        "CompiledXylo",
        "Counts",
        "Divergence",
        "EpochRecord",
        "ErrorBudget",
        "Expected",
        "Member",
        "PopulationMatch",
        "Probe",
        "Readout",
        "SensorLayout",
        "SrmAlpha",
    }


def test_lines_of_large_types_name_their_parts(compiled):
    assert repr(compiled).startswith(
        "<CompiledModel 'small-hybrid' on loihi-sim: The chip predicts the same class as the "
        "float network in 1 of 1 "
    )
    assert repr(compiled.network.populations[0]) == (
        "Population(name='time_hidden', axis='time', size=3, neuron=<SrmAlpha>)"
    )
    assert repr(lc.Projection("a" * 99, "b", np.ones((2, 3)))) == (
        f"Projection(source='{'a' * 40}'..., target='b', weights=<float64 (2, 3)>)"
    )
    assert repr(lc.TrainingConfig(epochs=3, theta=2.5)) == "TrainingConfig(epochs=3, theta=2.5)"


def own_types(hint):
    """Return the types of this project in an annotation, such as ``Network`` in ``list[Network] | None``."""
    arguments = typing.get_args(hint)
    if arguments:
        return set().union(*(own_types(argument) for argument in arguments))
    if inspect.isclass(hint) and hint.__module__.startswith(("hw_model", "locsnn_compile")):
        return {hint}
    return set()


def test_every_type_of_a_public_function_can_be_imported():
    annotated = [value for value in PUBLIC.values() if inspect.isfunction(value)]
    for member in vars(lc.CompiledModel).values():
        if isinstance(member, property):
            annotated.append(member.fget)
    annotated.append(lc.CompiledModel)
    types = set()
    for value in annotated:
        for hint in typing.get_type_hints(value).values():
            types |= own_types(hint)
    assert {kind.__name__ for kind in types} - set(PUBLIC) == set()
    assert {lc.Match, lc.Network, lc.Checkpoint, hw.Profile} <= types


def test_a_saved_folder_has_the_program_and_the_report(compiled, tmp_path):
    build = tmp_path / "build"
    compiled.save(build)
    names = {"program.yaml", "program.npz", "report.json", "report.md", "report.html"}
    assert {file.name: file.read_bytes() for file in build.iterdir()} == compiled.files()
    assert set(compiled.files()) == names
    document = json.loads((build / "report.json").read_bytes())
    assert document == json.loads(json.dumps(compiled.report))
    assert hw.load_program(build).populations == compiled.program.populations
    assert compiled.to_html().encode() == compiled.files()["report.html"]


def test_a_folder_that_cannot_be_written_is_refused(compiled, tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(lc.InputError) as caught:
        compiled.save(tmp_path / "file")
    assert str(caught.value) == (
        "output 'file': cannot be written: not a directory. With -o, choose a folder that you may write to."
    )
    assert (tmp_path / "file").read_text() == "mine"


def test_a_notebook_shows_the_summary(compiled):
    page = compiled._repr_html_()
    assert page.startswith("<p><strong>small-hybrid on loihi-sim</strong>")
    for question in ("Does it match?", "What does it cost?", "Does it fit?"):
        assert question in page
    assert "<script" not in page + compiled.to_html()


def test_a_notebook_shows_names_as_text_and_not_as_html(compiled):
    report = compiled.report | {"model": {"name": "<script>", "sha256": "", "members": []}}
    figures = typed(ReportFigures, report)
    assert "<script" not in replace(compiled, figures=figures)._repr_html_()


def test_a_network_by_hand_compiles():
    network = by_hand()
    compiled = lc.compile(network, events=recordings(network), diagnosis=False)
    assert compiled.match.spikes.reference_spikes > 0
    assert network.projections[0].weights.dtype == np.float64
    assert not network.projections[0].weights.flags.writeable


def test_a_network_copies_arrays_that_may_change():
    weights = np.ones((2, 3))
    projection = lc.Projection("a", "b", weights)
    weights[0, 0] = 7
    assert projection.weights[0, 0] == 1
    # The copy is read-only, so it is shared from then on.
    assert replace(projection, target="c").weights is projection.weights


READOUT = "readout: its populations or weights do not fit together"
ONE_SIZE = "Name populations of one size, each with its weight."
ONE = lc.Projection("touch", "hidden", np.ones((3, 4)))
BROKEN = [
    pytest.param(
        lambda: lc.Projection("touch", "hidden", [["a"]]),
        "projection 'touch' -> 'hidden': the weights are not an array of numbers. Give one "
        "row per target and one column per source.",
        id="weights that are words",
    ),
    pytest.param(
        lambda: lc.Projection("touch", "hidden", [[1.0], [1.0, 2.0]]),
        "projection 'touch' -> 'hidden': the weights are not an array of numbers. Give one "
        "row per target and one column per source.",
        id="rows of two lengths",
    ),
    pytest.param(
        lambda: lc.Cuba.of(3, decay_v=[0.1, 0.2], threshold=1.0),
        "neurons: a parameter has the wrong shape ((2,) against (3,)). Give one number per neuron.",
        id="parameters of other neurons",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(projections=(replace(ONE, weights=np.ones((4, 3))),))),
        "projection 'touch' -> 'hidden': the weights have the wrong shape ((4, 3) against "
        "(3, 4)). Give one row per target and one column per source.",
        id="weights the other way round",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout(("score",), (1.0,)))),
        f"{READOUT} (populations ('score',), sizes [], weights (1.0,)). {ONE_SIZE}",
        id="scores of nobody",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout(("scores", "hidden"), (1.0, 1.0)))),
        f"{READOUT} (populations ('scores', 'hidden'), sizes [2, 3], weights (1.0, 1.0)). "
        f"{ONE_SIZE}",
        id="scores of two sizes",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout(("scores",), ()))),
        f"{READOUT} (populations ('scores',), sizes [2], weights ()). {ONE_SIZE}",
        id="scores without weights",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout(("scores",), (float("nan"),)))),
        f"{READOUT} (populations ('scores',), sizes [2], weights (nan,)). {ONE_SIZE}",
        id="scores that are no numbers",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout(("scores",), (1e300,)))),
        "readout: a weight is too large a number to compute with (1e+300 against 1e-100 to "
        "1e+100). Give it in other units.",
        id="scores beyond measure",
    ),
    pytest.param(
        lambda: lc.Projection("touch", "hidden", [[1j]]),
        "projection 'touch' -> 'hidden': the weights are not an array of numbers. Give one "
        "row per target and one column per source.",
        id="complex weights",
    ),
    pytest.param(
        lambda: lc.Projection("touch", "hidden", [[10**400]]),
        "projection 'touch' -> 'hidden': the weights are not an array of numbers. Give one "
        "row per target and one column per source.",
        id="weights beyond floats",
    ),
    pytest.param(
        lambda: lc.compile(by_hand(readout=lc.Readout((), ()))),
        f"{READOUT} (populations (), sizes [], weights ()). {ONE_SIZE}",
        id="no scores",
    ),
]


@pytest.mark.parametrize(("call", "message"), BROKEN)
def test_an_inconsistent_network_by_hand_is_refused(call, message):
    with pytest.raises(lc.InputError) as caught:
        call()
    assert str(caught.value) == message
