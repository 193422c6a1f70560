"""Public functions name a wrong argument in one line: which it is, what it must be, and what was given."""

from __future__ import annotations

from pathlib import Path
from types import GenericAlias
from typing import Any, Optional

import numpy as np
import pytest
from numpy.typing import NDArray

import hw_model as hw
import locsnn_compile as lc
from hw_model.io.arguments import classes_of
from hw_model.streaming.psi import location_share

NETWORK = "Read it with lc.load(path), or lc.load(path, config=...)."
PROGRAM = "Take .program of lc.compile(network), or read one with hw.load_program(folder)."
CHIP = "Use hw.chip('loihi-sim'), or hw.chip(path) of a chip file."
LONG = "n" * 300


@pytest.fixture(scope="module")
def program():
    """One compartment that hears one channel."""
    b = hw.ProgramBuilder(hw.chip("tiny-sim"))
    h = b.add_compartments("h", 1, decay_u=4096, decay_v=0, threshold=10)
    b.connect(b.add_input("x", 1), h, [[20]])
    b.read_out(h)
    return b.build()


@pytest.fixture(scope="module")
def network():
    """A network that ships with the project."""
    return lc.load(Path(__file__).parents[2] / "examples/models/objects-hybrid.pt")


REFUSED_CALLS = [
    pytest.param(
        lambda: lc.Cuba.of(2, decay=0.1, threshold=1.0),
        "Cuba.of: there is no parameter 'decay'. Did you mean 'decay_v'?",
        id="a parameter that neurons have not",
    ),
    pytest.param(
        lambda: lc.Cuba.of(2, decay_v=0.1),
        "Cuba.of: parameter 'threshold' is missing. Give it by its name.",
        id="neurons without a threshold",
    ),
    pytest.param(
        lambda: lc.compile("model.pt"),
        "compile, network: it must be a Network, Checkpoint or Sequence (got str "
        f"'model.pt'). {NETWORK}",
        id="a path for a network",
    ),
    pytest.param(
        lambda: lc.compile(Path("model.pt")),
        "compile, network: it must be a Network, Checkpoint or Sequence (got PosixPath "
        f"PosixPath('model.pt')). {NETWORK}",
        id="a Path for a network",
    ),
    pytest.param(
        lambda: lc.compile(None),
        "compile, network: it must be a Network, Checkpoint or Sequence (got NoneType None). "
        f"{NETWORK}",
        id="nothing for a network",
    ),
    pytest.param(
        lambda: lc.verify("build", "d.npz"),
        "verify, compiled: it must be a CompiledModel (got str 'build'). Make one with "
        "lc.compile(network).",
        id="a path for a build",
    ),
    pytest.param(
        lambda: lc.diagnose("build", "d.npz"),
        "diagnose, compiled: it must be a CompiledModel (got str 'build'). Make one with "
        "lc.compile(network).",
        id="a diagnosis of a path",
    ),
    pytest.param(
        lambda: lc.load(3),
        "load, model: it must be a str, Path or Checkpoint (got int 3). Correct it.",
        id="a number for a model",
    ),
    pytest.param(
        lambda: lc.load("m.nir", dt="1e-3"),
        "load, dt: it must be a float (got str '1e-3'). Correct it.",
        id="a step of text",
    ),
    pytest.param(
        lambda: lc.load(f"{LONG}.pt"),
        f"model '{LONG[:60]}...': the name is too long (303 bytes). Shorten it.",
        id="a model of a long name",
    ),
    pytest.param(
        lambda: lc.load("d/" * 2100 + "m.pt"),
        f"model '{'d/' * 30}...': the path is too long (4204 bytes). Shorten it.",
        id="a model of a long path",
    ),
    pytest.param(
        lambda: lc.load("a\0.pt"),
        r"model 'a\x00.pt': it contains a NUL character. Give the path of a file.",
        id="a model of a NUL",
    ),
    pytest.param(
        lambda: lc.read_recordings(3),
        "read_recordings, path: it must be a Path or str (got int 3). Correct it.",
        id="recordings of a number",
    ),
    pytest.param(
        lambda: lc.read_recordings("d.npz", steps="3"),
        "read_recordings, steps: it must be an int (got str '3'). Correct it.",
        id="steps of text",
    ),
    pytest.param(
        lambda: lc.read_recordings(LONG),
        f"path '{LONG[:60]}...': the name is too long (300 bytes). Shorten it.",
        id="recordings of a long name",
    ),
    pytest.param(
        lambda: hw.chip(3),
        "chip, name_or_path: it must be a str or Path (got int 3). Correct it.",
        id="a chip of a number",
    ),
    pytest.param(
        lambda: hw.priced_by("loihi-sim", "x"),
        f"priced_by, chip: it must be a Chip (got str 'loihi-sim'). {CHIP}",
        id="prices of a name",
    ),
    pytest.param(
        lambda: hw.ProgramBuilder("loihi-sim"),
        f"ProgramBuilder, chip: it must be a Chip (got str 'loihi-sim'). {CHIP}",
        id="a builder of a name",
    ),
    pytest.param(
        lambda: hw.load_program(3),
        "load_program, folder: it must be a str or Path (got int 3). Correct it.",
        id="a program of a number",
    ),
    pytest.param(
        lambda: hw.simulate("build", [[1]]),
        f"simulate, program: it must be a ChipProgram (got str 'build'). {PROGRAM}",
        id="a simulation of a path",
    ),
    pytest.param(
        lambda: hw.Session("build"),
        f"Session, program: it must be a ChipProgram (got str 'build'). {PROGRAM}",
        id="a session of a path",
    ),
    pytest.param(
        lambda: hw.stop_when_proven("build", [[1]]),
        f"stop_when_proven, program: it must be a ChipProgram (got str 'build'). {PROGRAM}",
        id="stops of a path",
    ),
    pytest.param(
        lambda: hw.timestep_scores("build", [[1]]),
        f"timestep_scores, program: it must be a ChipProgram (got str 'build'). {PROGRAM}",
        id="scores of a path",
    ),
    pytest.param(
        lambda: hw.prove_range("build"),
        f"prove_range, program: it must be a ChipProgram (got str 'build'). {PROGRAM}",
        id="a proof of a path",
    ),
    pytest.param(
        lambda: hw.energy_pj(3, 4),
        "energy_pj, counts: it must be a Counts (got int 3). Take .counts of "
        "hw.simulate(program, spikes).",
        id="energy of a number",
    ),
    pytest.param(
        lambda: hw.energy_pj(hw.Counts(), "sanafe"),
        "energy_pj, profile: it must be a Profile (got str 'sanafe'). Use chip.profile(name).",
        id="energy by a name",
    ),
    pytest.param(
        lambda: lc.ErrorBudget(2.0),
        "budget 'min_agreement': it must be a number from 0 to 1 (got 2.0). Correct it.",
        id="a budget in percent",
    ),
    pytest.param(
        lambda: lc.ErrorBudget(None, 1.5),
        "budget 'max_spike_error': it must be a number from 0 to 1 (got 1.5). Correct it.",
        id="a budget of more than all spikes",
    ),
    pytest.param(
        lambda: lc.ErrorBudget(None, None, -0.1),
        "budget 'max_score_error': it must be a number of at least 0 (got -0.1). Correct it.",
        id="a budget below any error",
    ),
    pytest.param(
        lambda: lc.Cuba.of(2, decay_v="x", threshold=1.0),
        "neurons: a parameter is not a number (<U1). Give numbers.",
        id="a neuron of text",
    ),
    pytest.param(
        lambda: lc.Cuba.of(2, decay_v=1j, threshold=1.0),
        "neurons: a parameter is not a number (complex128). Give numbers.",
        id="a neuron of a complex number",
    ),
    pytest.param(
        lambda: lc.ChipCuba.of(2, decay_u=[[1, 2], [3]], decay_v=0, threshold=1),
        "Neuron.of, decay_u: it is not an array: its rows differ in length. Make them equal.",
        id="a neuron of rows that differ",
    ),
    pytest.param(
        lambda: lc.Cuba.of(0.5, decay_v=0.1, threshold=1.0),
        "Neuron.of, size: it must be an int (got float 0.5). Correct it.",
        id="half a neuron",
    ),
    pytest.param(
        lambda: lc.Cuba.of(0, decay_v=0.1, threshold=1.0),
        "size: it is out of range (got 0 against 1..10000000). Correct the number.",
        id="no neuron",
    ),
    pytest.param(
        lambda: lc.Cuba.of(2**31, decay_v=0.1, threshold=1.0),
        "size: it is out of range (got 2147483648 against 1..10000000). Correct the number.",
        id="more neurons than memory",
    ),
    pytest.param(
        lambda: hw.ProgramBuilder(hw.chip("tiny-sim")).add_compartments("h", 2**31, threshold=1),
        "'h': no chip holds so many (2147483648 against 10000000). Give a smaller size.",
        id="more compartments than memory",
    ),
]
OF_A_NETWORK = [
    (
        "target",
        3,
        "compile, target: it must be a str, Path, Chip, XyloChip or SpinnakerChip (got int 3). "
        "Use hw.chip('loihi-sim'), or hw.chip(path) of a chip file.",
    ),
    ("strategy", 5, "compile, strategy: it must be a str (got int 5). Correct it."),
    ("weight_bits", "8", "compile, weight_bits: it must be an int (got str '8'). Correct it."),
    ("weight_bits", True, "compile, weight_bits: it must be an int (got bool True). Correct it."),
    ("psi", "x", "compile, psi: it must be a float (got str 'x'). Correct it."),
    ("budget", 3, "compile, budget: it must be an ErrorBudget (got int 3). Correct it."),
    (
        "split_weights",
        "all",
        "compile, split_weights: it must be a float (got str 'all'). Correct it.",
    ),
    ("profile", 3, "compile, profile: it must be a str or Path (got int 3). Correct it."),
    ("progress", 3, "compile, progress: it must be a Callable (got int 3). Correct it."),
    (
        "events",
        object(),
        "recordings 'array': its number of axes is wrong (0 against 3). "
        "Give an array (samples, steps, channels).",
    ),
    ("events", LONG, f"events '{LONG[:60]}...': the name is too long (300 bytes). Shorten it."),
    (
        "labels",
        [0],
        "labels: they belong to an array, and other events bring their own. Leave labels out.",
    ),
]
OF_A_PROGRAM = [
    ("steps", "3", "simulate, steps: it must be an int (got str '3'). Correct it."),
    (
        "probe",
        "spikes",
        "simulate, probe: it must be a Sequence (got str 'spikes'). Put it in a list.",
    ),
    ("probe", (3,), "probe 3: does not exist. Choose one of: activity, potential, spikes, u, v."),
    ("engine", 3, "engine 3: does not exist. Choose one of: fast, reference."),
]


OF_ACTIVITY = [
    pytest.param(
        lambda activity: activity,
        "latency, activity['time']: it must be a StepActivity (got tuple "
        "(StepActivity(pieces=<Pieces>, routes=<Routes>, by_piece=<8 ...). Take that of a "
        "recording, result.activity[phase][0].",
        id="of all recordings",
    ),
    pytest.param(
        lambda activity: {"tiem": activity["time"][0]},
        "latency, activity: there is no phase 'tiem'. Did you mean 'time'?",
        id="a phase that does not exist",
    ),
    pytest.param(
        lambda activity: {None: activity["time"][0]},
        "latency, activity: there is no phase None. Choose one of: time.",
        id="a phase without a name",
    ),
]


def message_of(call):
    """Return the message with which a call is refused."""
    with pytest.raises(hw.InputError) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize(("call", "message"), REFUSED_CALLS)
def test_a_wrong_argument_is_named(call, message):
    assert message_of(call) == message


@pytest.mark.parametrize(("argument_of", "message"), OF_ACTIVITY)
def test_latency_takes_only_the_activity_of_one_recording(program, argument_of, message):
    activity = hw.simulate(program, [[1], [0]], probe=("activity",)).activity
    costs = hw.chip("tiny-sim").costs
    assert message_of(lambda: hw.latency(program, argument_of(activity), costs)) == message


@pytest.mark.parametrize(
    ("name", "value", "message"),
    OF_A_NETWORK,
    ids=[f"{row[0]} {row[1]!r:.9}" for row in OF_A_NETWORK],
)
def test_wrong_arguments_of_compile(network, name, value, message):
    assert message_of(lambda: lc.compile(network, **{name: value})) == message


@pytest.mark.parametrize(
    ("name", "value", "message"),
    OF_A_PROGRAM,
    ids=[f"{row[0]} {row[1]!r:.9}" for row in OF_A_PROGRAM],
)
def test_wrong_arguments_of_simulate(program, name, value, message):
    assert message_of(lambda: hw.simulate(program, [[1]], **{name: value})) == message


ROWS = "it is not an array: its rows differ in length. Make them equal."


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda p: hw.Session(p).push([[1], [0, 1]]), f"spikes: {ROWS}", id="rows pushed"
        ),
        pytest.param(
            lambda p: hw.simulate(p, {"x": [[1], [0, 1]]}),
            f"spikes of 'x': {ROWS}",
            id="rows of a stream",
        ),
        pytest.param(lambda p: hw.Session(p, psi=10**400), None, id="a psi that no float holds"),
    ],
)
def test_wrong_arguments_of_a_session(program, call, message):
    assert message_of(lambda: call(program)) == (
        message or "Session, psi: it is too large for a float (1329 bits). Correct it."
    )


def test_numbers_of_numpy_are_numbers(program):
    assert location_share(10**30, np.array([1, 2]), 2).tolist() == [0.0, 0.5]
    b = hw.ProgramBuilder(program.chip)
    b.connect(
        b.add_input("x", 1),
        b.add_compartments("h", 1, threshold=10),
        [[32]],
        weight_bits=np.int8(4),
    )
    assert hw.simulate(b.build(), [[1], [0]]).spikes["h"].ravel().tolist() == [0, 1]
    assert hw.simulate(program, [[1], [0]], steps=np.int64(3)).spikes["h"].shape == (3, 1)
    assert hw.calibrate_margin(program, [[[1], [0]]], np.float32(0.5)) > 0


def test_missing_arguments_raise_python_s_own_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'network'"):
        lc.compile()


def test_recordings_that_do_not_fit_are_refused_before_all_the_work(network, monkeypatch):
    monkeypatch.setattr(
        "locsnn_compile.mesh.compile.calibrate",
        lambda *_: pytest.fail("weights were rounded for them"),
    )
    monkeypatch.setattr(
        "locsnn_compile.request.choose_strategy.calibrate",
        lambda *_: pytest.fail("settings were compared"),
    )
    what = "the channel count differs from the model's (5 channels against 78)"
    with pytest.raises(lc.InputError) as caught:
        lc.compile(network, events=np.zeros((1, 9, 5)))
    assert str(caught.value) == f"events 'array': {what}. Give recordings of 78 channels."


class TypeAliasType:
    """Stands in for ``typing.TypeAliasType`` of Python 3.12 and later, which numpy uses for its aliases of arrays."""

    def __init__(self, value: object) -> None:
        self.__value__ = value


ALIAS = GenericAlias(TypeAliasType(np.ndarray[Any, np.dtype[Any]]), (np.int64,))


@pytest.mark.parametrize(
    ("hint", "classes"),
    [
        pytest.param(int, [int], id="a class"),
        pytest.param(tuple[int, ...], [tuple], id="a tuple"),
        pytest.param(int | None, [int, type(None)], id="one or nothing"),
        pytest.param(Optional[int], [int, type(None)], id="one or nothing, of typing"),  # noqa: UP045
        pytest.param(int | NDArray[np.int64], [int, np.ndarray], id="an array of numpy"),
        pytest.param(ALIAS, [np.ndarray], id="an alias"),
        pytest.param(TypeAliasType(int | ALIAS), [int, np.ndarray], id="an alias of several"),
    ],
)
def test_the_classes_of_an_annotation(hint, classes):
    """Arguments are checked against the classes in their annotations."""
    assert list(classes_of(hint)) == classes
