"""A plugin of pytest for mutants: the packages are the tree's own, examples are the same every time and not made smaller."""

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
