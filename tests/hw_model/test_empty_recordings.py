"""A recording without events is simulated once per program; later ones get copies of the result."""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from hw_model import simulation
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

KINDS = ("spikes", "u", "v", "potential", "activity")
STEPS = 40
COMPARTMENTS = 22  # of the program `biased`
# Biases and voltages are in units of the registers, thresholds and weights in units of 64 of them.


def biased() -> hw.ChipProgram:
    """Return compartments that spike and clip because of their biases, without any event."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 3)
    y = builder.add_compartments(
        "y", 20, threshold=90, bias=640 * np.arange(20), decay_u=FORGETS_AT_ONCE, decay_v=100
    )
    low = builder.add_compartments(
        "low", 2, threshold=90, bias=-64_000, decay_v=KEEPS_ALL, vmin=1 - 2**13
    )
    builder.connect(x, y, np.full((20, 3), 100))
    builder.connect(y, low, np.full((2, 20), 4))
    builder.read_out(y)
    return builder.build()


def at_rest() -> hw.ChipProgram:
    """Return a compartment without a bias: the fast engine skips every step without an event."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 3)
    y = builder.add_compartments("y", 1, threshold=90)
    builder.connect(x, y, np.full((1, 3), 100))
    return builder.build()


def arrays_in(value: object) -> list[np.ndarray]:
    """Return all arrays of a result, however deep they lie."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        value = tuple(value.values())
    if isinstance(value, tuple):
        return [array for item in value for array in arrays_in(item)]
    if isinstance(value, (hw.SimulationResult, simulation.StepActivity)):
        # Pieces and routes belong to the program, and are the same object in all results.
        fields = {
            name: item for name, item in vars(value).items() if name not in ("pieces", "routes")
        }
        return arrays_in(fields)
    return []


def check_equal(result: hw.SimulationResult, expected: hw.SimulationResult) -> None:
    """Compare every array and event of two results, and the types of arrays."""
    assert result.events == expected.events
    for array, expected_array in zip(arrays_in(result), arrays_in(expected), strict=True):
        assert np.array_equal(array, expected_array)
        assert array.dtype == expected_array.dtype


@pytest.mark.parametrize("batched", [False, True], ids=["rows", "a batch of one"])
def test_a_second_empty_recording_equals_the_first_and_the_plain_engine(batched):
    program = biased()
    nothing = np.zeros((STEPS, 3), dtype=np.uint8)
    nothing = nothing[None] if batched else nothing
    plain = hw.simulate(program, nothing, engine="reference", probe=KINDS)
    assert plain.counts.spikes > 0
    assert plain.counts.voltage_clips > 0
    for _ in range(2):
        result = hw.simulate(program, nothing, probe=KINDS)
        check_equal(result, plain)
        # A caller may write into its result: no other caller gets the same arrays.
        for array in arrays_in(result):
            array[...] = 77  # a value that none of these arrays has
        for kinds in result.events.values():
            kinds.clear()


def test_another_call_is_not_answered_from_memory():
    """Other rows, steps, probes, or a batch, and any event make it another call."""
    program = biased()
    nothing = np.zeros((STEPS, 3), dtype=np.uint8)
    hw.simulate(program, nothing)
    assert hw.simulate(program, nothing[:7]).spikes["y"].shape == (7, 20)
    assert hw.simulate(program, nothing, 9).spikes["y"].shape == (9, 20)
    assert hw.simulate(program, nothing[None]).spikes["y"].shape == (1, STEPS, 20)
    assert hw.simulate(program, nothing, probe=("u",)).u["y"].shape == (STEPS, 20)
    assert hw.simulate(program, np.stack([nothing] * 3)).spikes["y"].shape == (3, STEPS, 20)
    for row, channel in ((0, 0), (STEPS - 1, 2)):
        with_one_event = nothing.copy()
        with_one_event[row, channel] = 1
        assert hw.simulate(program, with_one_event).counts.input_events == 1


def test_a_call_without_skipping_is_not_answered_from_a_call_with_it():
    program = at_rest()
    nothing = np.zeros((STEPS, 3), dtype=np.uint8)
    assert hw.simulate(program, nothing).counts.skipped_steps == STEPS
    assert hw.simulate(program, nothing, skip=False).counts.skipped_steps == 0
    assert hw.simulate(program, nothing).counts.skipped_steps == STEPS


def test_events_of_one_stream_are_played_next_to_an_empty_one():
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    y = builder.add_compartments("y", 1, threshold=1, decay_u=FORGETS_AT_ONCE)
    for name in ("silent", "heard"):
        builder.connect(builder.add_input(name, 2), y, [[20, 20]])
    program = builder.build()
    heard = np.zeros((STEPS, 2), dtype=np.uint8)
    heard[3, 1] = 1
    result = hw.simulate(program, {"silent": np.zeros_like(heard), "heard": heard})
    assert (result.counts.input_events, result.counts.spikes) == (1, 1)


@pytest.fixture
def phases_played(monkeypatch) -> list[str]:
    """A list to which every simulation of the test adds the names of the phases that it plays."""
    names = []
    play = simulation.play

    def noted_play(program, phase, *arguments):
        names.append(phase.name)
        return play(program, phase, *arguments)

    monkeypatch.setattr(simulation, "play", noted_play)
    return names


@pytest.mark.parametrize("kind", ["uint8", "bool", "int64", "float64"])
def test_an_empty_recording_is_played_once(phases_played, kind):
    program = biased()
    nothing = np.zeros((STEPS, 3), dtype=kind)
    for _ in range(3):
        hw.simulate(program, nothing)
    assert phases_played == ["time"]
    for _ in range(2):
        hw.simulate(program, nothing, engine="reference")
    assert phases_played == ["time"] * 3
    nothing[2, 1] = 1
    assert hw.simulate(program, nothing).counts.input_events == 1


@pytest.mark.parametrize(
    ("max_remembered", "times_played"),
    [(COMPARTMENTS * STEPS, 1), (COMPARTMENTS * STEPS - 1, 2)],
    ids=["as large", "larger"],
)
def test_large_results_are_not_remembered(monkeypatch, phases_played, max_remembered, times_played):
    """The limit counts the bytes of the array of spikes: one for every compartment and step."""
    monkeypatch.setattr(simulation, "MAX_REMEMBERED", max_remembered)
    program = biased()
    for _ in range(2):
        assert hw.simulate(program, np.zeros((STEPS, 3), dtype=np.uint8)).counts.spikes > 0
    assert len(phases_played) == times_played
