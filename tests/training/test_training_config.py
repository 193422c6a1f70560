"""Training configurations in YAML files: the shipped ones load, and mistakes are named."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.describe import describe

CONFIGS = Path(__file__).parents[2] / "examples" / "configs"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_configurations_load(path: Path) -> None:
    assert config_from_mapping(read_config(path)).model in path.stem


def test_the_configuration_of_objects_has_the_defaults() -> None:
    assert config_from_mapping(read_config(CONFIGS / "objects-hybrid.yaml")) == TrainingConfig(
        step_seconds=0.02, defaults="fixed"
    )


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "+1.e-3", ".1e-2", "1.0e-3", "0.001"])
def test_a_number_may_be_written_with_an_exponent(text, tmp_path):
    path = tmp_path / "rate.yaml"
    path.write_text(f"learning_rate: {text}\n")
    assert config_from_mapping(read_config(path)).learning_rate == 0.001


@pytest.mark.parametrize(
    ("of_data", "of_config", "expected"),
    [
        pytest.param(0.001, None, 0.001, id="stated by the data"),
        pytest.param(None, 0.001, 0.001, id="stated by the configuration"),
        pytest.param(None, None, None, id="unknown"),
    ],
)
def test_the_width_of_steps_is_that_of_the_data_or_of_the_configuration(
    of_data: float | None, of_config: float | None, expected: float | None
) -> None:
    fingertip = np.ones((1, 5, 78))  # 39 taxels with two polarities
    recordings = Recordings(fingertip, np.array([0]), of_data, "x.npy")
    described = describe(recordings, TrainingConfig(step_seconds=of_config), classes=2)
    assert described.input.step_seconds == expected


def test_a_whole_number_is_taken_for_a_real_one() -> None:
    config = config_from_mapping({"theta": 5, "event_dropout": 0})
    assert (config.theta, config.event_dropout) == (5.0, 0.0)
    assert isinstance(config.theta, float)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            "epoch: 3",
            "config 'a.yaml': unknown key 'epoch'. Did you mean 'epochs'?",
            id="misspelt key",
        ),
        pytest.param(
            "model: hybird",
            "config 'a.yaml': model: 'hybird' is not known. Did you mean 'hybrid'?",
            id="misspelt model",
        ),
        pytest.param(
            "epochs: 0",
            "config 'a.yaml': epochs: it must be a whole number from 1 to 100000 (got 0). Correct it.",
            id="no epochs",
        ),
        pytest.param(
            "window_levels: 1",
            "config 'a.yaml': window_levels: it must be text (got 1). Put it in quotes.",
            id="a number for text",
        ),
        pytest.param(
            "epochs: 2.5",
            "config 'a.yaml': epochs: it must be a whole number from 1 to 100000 (got 2.5). Correct it.",
            id="half an epoch",
        ),
        pytest.param(
            "learning_rate: .nan",
            "config 'a.yaml': learning_rate: it must be a number from 1e-09 to 1000 (got nan). Correct it.",
            id="NaN",
        ),
        pytest.param(
            "learning_rate: fast",
            "config 'a.yaml': learning_rate: it must be a number from 1e-09 to 1000 (got 'fast'). Correct it.",
            id="a word for a number",
        ),
        pytest.param(
            "refit: 1",
            "config 'a.yaml': refit: it must be true or false (got 1). Correct it.",
            id="number for a truth value",
        ),
        pytest.param(
            "hidden: true",
            "config 'a.yaml': hidden: it must be a whole number from 1 to 4096 (got True). Correct it.",
            id="truth value for a number",
        ),
        pytest.param(
            "- epochs",
            "config 'a.yaml': it is not a mapping (list). Write one 'key: value' per line.",
            id="a list",
        ),
        pytest.param(
            "{",
            "config 'a.yaml': it is not a YAML file. Write one 'key: value' per line.",
            id="broken",
        ),
        pytest.param(
            "!!python/object/apply:os.system ['touch ran']",
            "config 'a.yaml': it is not a YAML file. Write one 'key: value' per line.",
            id="hostile",
        ),
        pytest.param(
            "model: " + "[" * 3000,
            "config 'a.yaml': it is nested too deeply (more than 50 levels). Correct its brackets.",
            id="deep",
        ),
        pytest.param("3: 4", "config 'a.yaml': unknown key '3'. {known}", id="a number for a key"),
    ],
)
def test_mistakes_in_a_configuration_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_config(tmp_path / "a.yaml")
    known = ", ".join(sorted(field.name for field in fields(TrainingConfig)))
    assert str(caught.value) == message.replace("{known}", f"Choose one of: {known}.")
    assert not (tmp_path / "ran").exists()


def test_a_missing_configuration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_config(tmp_path / "a.yaml")
    assert (
        str(caught.value)
        == "config 'a.yaml': it cannot be read (No such file or directory). Check the path."
    )
