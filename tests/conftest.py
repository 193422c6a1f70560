"""The same random numbers in every run, one thread for each process, and machine code that checks what it is given.

A run is then good or bad for what changed, not by luck. To look for new examples of hypothesis: ``make soak``.
"""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from hw_model.engine import compiled

if "PYTEST_XDIST_WORKER" in os.environ:
    # With a process per core, threads of numpy and torch would wait for each other. Commands have one thread as well.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_configure(config):
    """Let machine code check what it is given, except where it is timed."""
    if config.option.markexpr != "bench":
        os.environ.setdefault(compiled.CHECK_KINDS, "1")


@pytest.fixture
def unchecked(monkeypatch):
    """Let machine code check nothing, as outside of the tests; what other tests made goes on checking."""
    monkeypatch.delenv(compiled.CHECK_KINDS)
    monkeypatch.setattr(compiled, "code_by_function", {})


settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("soak", deadline=None, suppress_health_check=list(HealthCheck))
if settings.get_current_profile_name() == "default":
    settings.load_profile("same")

_AT_FIRST: dict[np.random.Generator, object] = {}


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Let a test draw what it would alone from the generators of its module, whichever tests ran before in its process."""
    for held in vars(getattr(item, "module", item)).values():
        if isinstance(held, np.random.Generator):
            held.bit_generator.state = _AT_FIRST.setdefault(held, held.bit_generator.state)
