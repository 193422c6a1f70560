"""Our SpiNNaker against the machine code of sPyNNaker: constants and registers of every step."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from make_environments import python_of, why_missing

from hw_model.arithmetic import spinnaker
from hw_model.spinnaker.fast import play_fast
from tests.spinnaker.record_machine import DRIVER, ask_machine
from tests.support.machine_files import differences, values_of
from tests.support.random_spinnaker import PHASE, random_case

pytestmark = pytest.mark.peers

FIRST_SEED = 1000
PROGRAMS = 1000
TOGETHER = 50
"""Programs that the machine code is given at a time."""


@pytest.fixture
def python() -> Path:
    reason = why_missing("spinnaker")
    if reason:
        pytest.skip(f"sPyNNaker: {reason}")
    return python_of("spinnaker")


def test_a_thousand_networks_play_as_in_the_machine_code(python, tmp_path):
    met = dict.fromkeys(spinnaker.EVENTS, 0)
    values = 0
    for first in range(FIRST_SEED, FIRST_SEED + PROGRAMS, TOGETHER):
        cases = [random_case(seed) for seed in range(first, first + TOGETHER)]
        for place, witness in enumerate(ask_machine(python, cases, tmp_path)):
            case = cases[place]
            result = play_fast(case.network, PHASE, case.spikes, case.lateness)
            assert differences(case, result, witness) == {}, first + place
            values += values_of(witness)
            for name, count in result.events.items():
                met[name] += count
    counted = ", ".join(f"{count:,} {name}" for name, count in met.items())
    print(
        f"\nmachine code of sPyNNaker: {PROGRAMS} programs, {values:,} values, 0 differ ({counted})"
    )
    assert values > 5_000_000
    assert min(met.values()) > 500


def test_every_exponential_is_that_of_the_machine_code(python, tmp_path):
    written = tmp_path / "exponentials.npz"
    call = [str(python), str(DRIVER), "--exponentials", str(written)]
    subprocess.run(call, check=True, timeout=3600)
    with np.load(written) as machine:
        x = machine["x"].tolist()
        assert len(x) == 704_106
        assert x[0] == spinnaker.EXPONENT_MIN - 1
        assert x[-1] == spinnaker.EXPONENT_MAX + 1
        expk = [spinnaker.expk(exponent) & (spinnaker.SPAN - 1) for exponent in x]
        assert expk == machine["expk"].tolist()
        assert [spinnaker.expulr(exponent) for exponent in x] == machine["expulr"].tolist()
    print(f"\nmachine code of sPyNNaker: {len(x):,} arguments of both exponentials, 0 differ")
