"""A plugin of pytest for runs with a fault planted.

Hypothesis draws the same examples in every run, and does not search for a smaller example that fails,
because only whether a test fails matters. The packages must come from the copied tree.
"""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

settings.register_profile(
    "mutants",
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
    deadline=None,
    derandomize=True,
    database=None,
)
settings.load_profile("mutants")


def pytest_sessionstart(session: pytest.Session) -> None:
    import hw_model

    assert Path(hw_model.__file__).is_relative_to(session.config.rootpath), (
        "another tree would be tested"
    )
