"""Public functions say in a line what they want, where they get something else."""

from __future__ import annotations

from pathlib import Path
from types import GenericAlias
from typing import Any, Optional

import numpy as np
import pytest
from numpy.typing import NDArray

import hw_model as hw
import locsnn_compile as lc
from hw_model.io.given import classes_of
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
    return lc.load(Path(__file__).parents[2] / "examples/models/objects-hybrid.pt")


WITHOUT = [
    ("a parameter that neurons have not", lambda: lc.Cuba.of(2, decay=0.1, threshold=1.0), "Cuba.of: there is no parameter 'decay'. Did you mean 'decay_v'?"),
    ("neurons without a threshold", lambda: lc.Cuba.of(2, decay_v=0.1), "Cuba.of: parameter 'threshold' is missing. Give it by its name."),
    ("a path for a network", lambda: lc.compile("model.pt"), f"compile, network: it must be a Network, Checkpoint or Sequence (got str 'model.pt'). {NETWORK}"),
    ("a Path for a network", lambda: lc.compile(Path("model.pt")), f"compile, network: it must be a Network, Checkpoint or Sequence (got PosixPath PosixPath('model.pt')). {NETWORK}"),
    ("nothing for a network", lambda: lc.compile(None), f"compile, network: it must be a Network, Checkpoint or Sequence (got NoneType None). {NETWORK}"),
    ("a path for a build", lambda: lc.verify("build", "d.npz"), "verify, compiled: it must be a CompiledModel (got str 'build'). Make one with lc.compile(network)."),
    ("a diagnosis of a path", lambda: lc.diagnose("build", "d.npz"), "diagnose, compiled: it must be a CompiledModel (got str 'build'). Make one with lc.compile(network)."),
    ("a number for a model", lambda: lc.load(3), "load, model: it must be a str, Path or Checkpoint (got int 3). Correct it."),
    ("a step of text", lambda: lc.load("m.nir", dt="1e-3"), "load, dt: it must be a float (got str '1e-3'). Correct it."),
    ("a model of a long name", lambda: lc.load(f"{LONG}.pt"), f"model '{LONG[:60]}...': the name is too long (303 bytes). Shorten it."),
    ("a model of a long path", lambda: lc.load("d/" * 2100 + "m.pt"), f"model '{'d/' * 30}...': the path is too long (4204 bytes). Shorten it."),
    ("a model of a NUL", lambda: lc.load("a\0.pt"), r"model 'a\x00.pt': it contains a NUL character. Give the path of a file."),
    ("recordings of a number", lambda: lc.read_recordings(3), "read_recordings, path: it must be a Path or str (got int 3). Correct it."),
    ("steps of text", lambda: lc.read_recordings("d.npz", steps="3"), "read_recordings, steps: it must be an int (got str '3'). Correct it."),
    ("recordings of a long name", lambda: lc.read_recordings(LONG), f"path '{LONG[:60]}...': the name is too long (300 bytes). Shorten it."),
    ("a chip of a number", lambda: hw.chip(3), "chip, name_or_path: it must be a str or Path (got int 3). Correct it."),
    ("prices of a name", lambda: hw.priced_by("loihi-sim", "x"), f"priced_by, chip: it must be a Chip (got str 'loihi-sim'). {CHIP}"),
    ("a builder of a name", lambda: hw.ProgramBuilder("loihi-sim"), f"ProgramBuilder, chip: it must be a Chip (got str 'loihi-sim'). {CHIP}"),
    ("a program of a number", lambda: hw.load_program(3), "load_program, folder: it must be a str or Path (got int 3). Correct it."),
    ("a simulation of a path", lambda: hw.simulate("build", [[1]]), f"simulate, program: it must be a ChipProgram (got str 'build'). {PROGRAM}"),
    ("a session of a path", lambda: hw.Session("build"), f"Session, program: it must be a ChipProgram (got str 'build'). {PROGRAM}"),
    ("stops of a path", lambda: hw.stop_when_proven("build", [[1]]), f"stop_when_proven, program: it must be a ChipProgram (got str 'build'). {PROGRAM}"),
    ("scores of a path", lambda: hw.timestep_scores("build", [[1]]), f"timestep_scores, program: it must be a ChipProgram (got str 'build'). {PROGRAM}"),
    ("a proof of a path", lambda: hw.prove_range("build"), f"prove_range, program: it must be a ChipProgram (got str 'build'). {PROGRAM}"),
    ("energy of a number", lambda: hw.energy_pj(3, 4), "energy_pj, counts: it must be a Counts (got int 3). Take .counts of hw.simulate(program, spikes)."),
    ("energy by a name", lambda: hw.energy_pj(hw.Counts(), "sanafe"), "energy_pj, profile: it must be a Profile (got str 'sanafe'). Use chip.profile(name)."),
    ("a budget in percent", lambda: lc.ErrorBudget(2.0), "budget 'min_agreement': it must be a number from 0 to 1 (got 2.0). Correct it."),
    ("a budget of more than all spikes", lambda: lc.ErrorBudget(None, 1.5), "budget 'max_spike_error': it must be a number from 0 to 1 (got 1.5). Correct it."),
    ("a budget below any error", lambda: lc.ErrorBudget(None, None, -0.1), "budget 'max_score_error': it must be a number of at least 0 (got -0.1). Correct it."),
    ("a neuron of text", lambda: lc.Cuba.of(2, decay_v="x", threshold=1.0), "neurons: a parameter is not a number (<U1). Give numbers."),
    ("a neuron of a complex number", lambda: lc.Cuba.of(2, decay_v=1j, threshold=1.0), "neurons: a parameter is not a number (complex128). Give numbers."),
    ("a neuron of rows that differ", lambda: lc.ChipCuba.of(2, decay_u=[[1, 2], [3]], decay_v=0, threshold=1), "Neuron.of, decay_u: it is not an array: its rows differ in length. Make them equal."),
    ("half a neuron", lambda: lc.Cuba.of(0.5, decay_v=0.1, threshold=1.0), "Neuron.of, size: it must be an int (got float 0.5). Correct it."),
    ("no neuron", lambda: lc.Cuba.of(0, decay_v=0.1, threshold=1.0), "size: it is out of range (got 0 against 1..10000000). Correct the number."),
    ("more neurons than memory", lambda: lc.Cuba.of(2**31, decay_v=0.1, threshold=1.0), "size: it is out of range (got 2147483648 against 1..10000000). Correct the number."),
    ("more compartments than memory", lambda: hw.ProgramBuilder(hw.chip("tiny-sim")).add_compartments("h", 2**31, threshold=1), "'h': no chip holds so many (2147483648 against 10000000). Give a smaller size."),
]  # fmt: skip
OF_A_NETWORK = [
    ("target", 3, "compile, target: it must be a str, Path, Chip, XyloChip or SpinnakerChip (got int 3). Use hw.chip('loihi-sim'), or hw.chip(path) of a chip file."),
    ("strategy", 5, "compile, strategy: it must be a str (got int 5). Correct it."),
    ("weight_bits", "8", "compile, weight_bits: it must be an int (got str '8'). Correct it."),
    ("weight_bits", True, "compile, weight_bits: it must be an int (got bool True). Correct it."),
    ("psi", "x", "compile, psi: it must be a float (got str 'x'). Correct it."),
    ("budget", 3, "compile, budget: it must be an ErrorBudget (got int 3). Correct it."),
    ("split_weights", "all", "compile, split_weights: it must be a float (got str 'all'). Correct it."),
    ("profile", 3, "compile, profile: it must be a str or Path (got int 3). Correct it."),
    ("progress", 3, "compile, progress: it must be a Callable (got int 3). Correct it."),
    ("events", object(), "recordings 'array': its number of axes is wrong (0 against 3). Give an array (samples, steps, channels)."),
    ("events", LONG, f"events '{LONG[:60]}...': the name is too long (300 bytes). Shorten it."),
    ("labels", [0], "labels: they belong to an array, and other events bring their own. Leave labels out."),
]  # fmt: skip
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
    ("of all recordings", lambda activity: activity, "latency, activity['time']: it must be a StepActivity (got tuple (StepActivity(pieces=<Pieces>, routes=<Routes>, by_piece=<8 ...). Take that of a recording, result.activity[phase][0]."),
    ("a phase that does not exist", lambda activity: {"tiem": activity["time"][0]}, "latency, activity: there is no phase 'tiem'. Did you mean 'time'?"),
    ("a phase without a name", lambda activity: {None: activity["time"][0]}, "latency, activity: there is no phase None. Choose one of: time."),
]  # fmt: skip


def message_of(call):
    """The message with which a call is refused."""
    with pytest.raises(hw.InputError) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"), [row[1:] for row in WITHOUT], ids=[row[0] for row in WITHOUT]
)
def test_wrong_arguments(call, message):
    assert message_of(call) == message


@pytest.mark.parametrize(
    ("given", "message"), [row[1:] for row in OF_ACTIVITY], ids=[row[0] for row in OF_ACTIVITY]
)
def test_latency_of_what_is_not_the_activity_of_a_recording(program, given, message):
    activity = hw.simulate(program, [[1], [0]], probe=("activity",)).activity
    assert (
        message_of(lambda: hw.latency(program, given(activity), hw.chip("tiny-sim").costs))
        == message
    )


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


def test_calls_that_python_refuses_stay_python_s():
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
    """Stands for Python's own, which versions before 3.12 lack: what numpy's aliases of arrays are there."""

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
def test_classes_behind_hints(hint, classes):
    assert list(classes_of(hint)) == classes
