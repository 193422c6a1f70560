"""Examples that hypothesis makes: the same in every run, unless a profile is asked for. And one thread for each process.

A run is then good or bad for what changed, not by luck. To look for new examples: ``make soak``.
"""

import os

from hypothesis import HealthCheck, settings

if "PYTEST_XDIST_WORKER" in os.environ:
    # With a process per core, threads of numpy and torch would wait for each other. Commands have one thread as well.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("soak", deadline=None, suppress_health_check=list(HealthCheck))
if settings.get_current_profile_name() == "default":
    settings.load_profile("same")
