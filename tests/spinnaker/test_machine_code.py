"""Both engines of SpiNNaker against what the machine code of sPyNNaker did with the same networks.

The code that sPyNNaker ships for the chip's cores ran in an emulator, and every register was recorded
(``record_machine.py``); such a record is called a *witness*. Planted faults show that the witnesses would find errors of
the arithmetic.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic.spinnaker import ONE, SPAN
from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.reference import play_reference
from tests.support.machine_files import RECORDED, case_of, differences
from tests.support.numbered_arrays import read
from tests.support.random_spinnaker import PHASE

WITNESSES = read(RECORDED)


@pytest.mark.parametrize("play", [play_reference, play_fast])
@pytest.mark.parametrize("number", range(len(WITNESSES)))
def test_every_constant_and_register_is_that_of_the_machine_code(number, play):
    case = case_of(WITNESSES[number])
    result = play(case.network, PHASE, case.spikes, case.lateness)
    assert differences(case, result, WITNESSES[number]) == {}


def test_the_recorded_networks_meet_all_that_the_arithmetic_distinguishes():
    """Every counted event, potentials exactly at the threshold, and time constants too long for an exponential."""
    event_counts = dict.fromkeys(spinnaker.EVENTS, 0)
    at_threshold = 0
    currents_of_one_step = 0
    for witness in WITNESSES:
        case = case_of(witness)
        result = play_reference(case.network, PHASE, case.spikes, case.lateness)
        for name, count in result.events.items():
            event_counts[name] += count
        at_threshold += np.count_nonzero(result.potential == witness["parameters.v_thresh"])
        # Above 2^30 (32,768 ms), the exponent 2^30 // tau_syn is 0, and e^0 is 0 in u0.32: the longest time constants
        # give currents that are gone after one step.
        currents_of_one_step += np.count_nonzero(witness["parameters.tau_syn"] > 1 << 30)
    assert all(event_counts.values())
    assert at_threshold > 50
    assert currents_of_one_step > 0


# Faulty versions of functions of hw_model/arithmetic/spinnaker.py, with the arguments of the sound ones.


def _rounded_product(goal, distance, membrane_decay):
    return goal - ((distance * membrane_decay + ONE // 2) >> 15)


def _towards_zero(goal, distance, membrane_decay):
    product = distance * membrane_decay
    return goal - np.sign(product) * (np.abs(product) >> 15)


def _share_of_2_to_32(tau_syn, synapse_decay):
    return (tau_syn * (SPAN - synapse_decay) >> 15) % SPAN


def _share_without_a_wrap(tau_syn, synapse_decay):
    return np.minimum(tau_syn * (SPAN - 1 - synapse_decay) >> 15, SPAN - 1)


def _unrounded_share(wide, factor):
    return wide * factor >> 32


def _step_that(**changes: Callable[..., Any]) -> Callable[..., Any]:
    """Return a faulty step: the sound one, with its ``fired`` or ``state`` replaced by what ``changes`` return."""

    def faulty(p, c, shifts, state, ring):
        sound = SOUND_STEP(p, c, shifts, state, ring)
        return sound._replace(
            **{name: change(p, c, state, sound) for name, change in changes.items()}
        )

    return faulty


SOUND_STEP = spinnaker.step
SOUND_EXPULR = spinnaker.expulr


def _refractory_one_longer(p, c, state, sound):
    steps_left = np.where(sound.fired, c.refractory_steps + 1, sound.state.refractory)
    return sound.state._replace(refractory=steps_left)


def _silent_while_refractory(p, c, state, sound):
    return sound.fired & (state.refractory == 0)


def _currents_cleared_by_a_spike(p, c, state, sound):
    return sound.state._replace(current=np.where(sound.fired[:, None], 0, sound.state.current))


# By what is wrong: the function or constant of the arithmetic, and what takes its place.
FAULTS = {
    "the membrane's product is rounded to nearest": ("approached", _rounded_product),
    "the membrane's product is rounded towards 0": ("approached", _towards_zero),
    "products of the exponentials are not rounded": ("_share", _unrounded_share),
    "e^0 is the largest u0.32": ("expulr", lambda x: SOUND_EXPULR(x) if x else SPAN - 1),
    "2^32 instead of 2^32 - 1 in the initial share": ("initial_share", _share_of_2_to_32),
    "the initial share saturates": ("initial_share", _share_without_a_wrap),
    "a current fades towards 0": (
        "faded",
        lambda current, decay: np.sign(current) * (np.abs(current) * decay >> 32),
    ),
    "sums saturate": ("wrap", lambda x: np.clip(x, -(1 << 31), (1 << 31) - 1)),
    "inhibition excites": (
        "drive_of",
        lambda excitation, inhibition, offset: excitation + inhibition + offset,
    ),
    "a goal leaves out the membrane's resistance": (
        "goal_of",
        lambda drive, resistance, v_rest: v_rest + drive,
    ),
    "a ring buffer saturates at 65,534": ("RING_MAX", 65534),
    "a ring buffer wraps": ("collected", lambda entry, weight: (entry + weight) % (1 << 16)),
    "a synapse late by its delay still acts": (
        "comes_too_late",
        lambda lateness, delay, slots: delay < slots and lateness > delay,
    ),
    "a delay of all slots can be too late": (
        "comes_too_late",
        lambda lateness, delay, slots: lateness >= delay,
    ),
    "a spike acts a step late": ("slot_of", lambda sent, delay, slots: (sent + delay + 1) % slots),
    "refractory for a step longer": ("step", _step_that(state=_refractory_one_longer)),
    "no spike in refractory steps": ("step", _step_that(fired=_silent_while_refractory)),
    "a spike clears the currents": ("step", _step_that(state=_currents_cleared_by_a_spike)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_witnesses_reveal_a_planted_fault(fault, monkeypatch):
    """Only the reference engine runs: the loops of the fast one are compiled, and would not see the replaced function."""
    name, faulty = FAULTS[fault]
    monkeypatch.setattr(spinnaker, name, faulty)
    differing_values = 0
    for witness in WITNESSES:
        case = case_of(witness)
        result = play_reference(case.network, PHASE, case.spikes, case.lateness)
        differing_values += sum(differences(case, result, witness).values())
    assert differing_values > 0


EXPONENTIALS = {
    "expk": "17f887efb84814586dc2c931a2e6b20193949466585a93ed6ca7e6dd4766f260",
    "expulr": "65481c61433742492055387e77821102f272c0c3187d6454ecb8ddbbe0c5d37b",
}
"""SHA-256 of what the machine code gave for every argument, as words of 32 bits, lowest byte first.

A digest stands for 704,106 values, which would be a file of several megabytes.
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPONENTIALS)
def test_every_exponential_is_that_of_the_machine_code(name):
    exponential = getattr(spinnaker, name)
    arguments = range(spinnaker.EXPONENT_MIN - 1, spinnaker.EXPONENT_MAX + 2)
    assert len(arguments) == 704_106
    words = np.array([exponential(x) % SPAN for x in arguments], dtype="<u4")
    assert hashlib.sha256(words.tobytes()).hexdigest() == EXPONENTIALS[name]
