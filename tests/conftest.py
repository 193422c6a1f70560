"""Settings of every test: the same random numbers in every run, one thread per process, checked arguments.

With equal random numbers, a test that begins to fail does so because the code changed. ``make soak`` lets
hypothesis look for new examples.
"""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from hw_model.engine import compiled

if "PYTEST_XDIST_WORKER" in os.environ:
    # With a process per core, threads of numpy and torch would wait for each other. The commands that tests start
    # inherit these variables.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_configure(config):
    """Let compiled functions check the types of their arguments, except in benchmarks, which time them."""
    if config.option.markexpr != "bench":
        os.environ.setdefault(compiled.CHECK_KINDS, "1")


@pytest.fixture
def unchecked(monkeypatch):
    """Let compiled functions check nothing, as outside of the tests.

    The cache of compiled functions is replaced, since those that other tests compiled contain the checks.
    """
    monkeypatch.delenv(compiled.CHECK_KINDS)
    monkeypatch.setattr(compiled, "code_by_function", {})


settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("soak", deadline=None, suppress_health_check=list(HealthCheck))
if settings.get_current_profile_name() == "default":
    settings.load_profile("same")

_FIRST_STATES: dict[np.random.Generator, object] = {}
"""For each generator in a test module: its state before any test drew from it."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Reset the random generators of a test's module, so that it draws the same numbers whichever tests ran before."""
    for value in vars(getattr(item, "module", item)).values():
        if isinstance(value, np.random.Generator):
            first_state = _FIRST_STATES.setdefault(value, value.bit_generator.state)
            value.bit_generator.state = first_state
