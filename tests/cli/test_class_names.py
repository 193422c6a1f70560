"""From the data to the report: the order of axes, and the names of classes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.data.axes import parse_axes, to_step_major
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint_reader import read_checkpoint

Capture = pytest.CaptureFixture[str]
NAMES = ("press", "slide", "twist")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(call: object, *args: object, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        call(*args, **options)  # type: ignore[operator]
    return str(caught.value)


def write(name: str = "a.npz", *, step_major: bool = False, **more: object) -> str:
    touches = synthetic_touches(6, steps=20, classes=3)
    spikes = touches.spikes if step_major else touches.spikes.transpose(0, 2, 1)
    np.savez(name, **{"spikes": spikes, "labels": touches.labels, "class_names": NAMES} | more)  # type: ignore[arg-type]
    return name


def train(data: str, *options: str, output: str = "a.pt") -> int:
    return locsnn_main(["train", "--data", data, "--epochs", "1", "--quiet", "-o", output, *options])


def compiled(*options: str, model: str = "a.pt") -> dict:
    assert compile_main([model, "--quiet", "-o", "built", *options]) == 0
    return json.loads(Path("built/report.json").read_text("utf-8"))


def test_another_order_of_axes_is_said_by_an_option_or_by_the_file(capsys: Capture) -> None:
    plain, turned = write(), write("b.npz", step_major=True)
    said = write("c.npz", step_major=True, axes="samples,steps,channels")
    axes = ("--axes", "samples,steps,channels")
    runs = ((plain, ()), (turned, axes), (said, ()), (said, axes))
    weights = []
    for data, options in runs:
        assert train(data, *options) == 0
        weights.append(read_checkpoint("a.pt").weights["time_hidden"])
    assert all(np.array_equal(weights[0], other) for other in weights)
    assert train(said, "--axes", "samples,channels,steps") == 2
    assert capsys.readouterr().err == (
        "axes: file 'c.npz' says another order (samples,steps,channels). Leave it out.\n"
    )


def test_class_names_travel_and_must_agree(capsys: Capture) -> None:
    train(write())
    assert read_checkpoint("a.pt").description.class_names == NAMES
    report = compiled("--events", "a.npz")
    assert report["classes"] == list(NAMES)
    assert "| twist |" in Path("built/report.md").read_text("utf-8")
    other = write("b.npz", class_names=("twist", "slide", "press"))
    assert compile_main(["a.pt", "--events", other, "--quiet", "-o", "other"]) == 2
    assert capsys.readouterr().err == (
        "recordings 'b.npz': their classes have other names than those of model 'a' (twist, slide, press against press, "
        "slide, twist). Give recordings of the same classes, in the same order.\n"
    )
    assert train(other, "--from", "a.pt", output="b.pt") == 2
    assert "than those of the network to start from" in capsys.readouterr().err


@pytest.mark.parametrize("names", [("press", "slide"), ("press", "press", "twist"), ("press", "", "twist")])
def test_class_names_that_do_not_fit(names: tuple[str, ...], capsys: Capture) -> None:
    assert train(write(class_names=names)) == 2
    held = len({name for name in names if name})
    assert capsys.readouterr().err == (
        f"recordings 'a.npz': its class names do not fit its classes ({held} different ones against 3). "
        "Give a name of at most 80 characters for each class, from class 0 on.\n"
    )


def test_folders_are_classes_and_recordings_have_lengths_of_their_own(capsys: Capture) -> None:
    touches = synthetic_touches(6, steps=24, classes=3)
    for i, (spikes, label) in enumerate(zip(touches.spikes, touches.labels, strict=True)):  # type: ignore[arg-type]
        for part in ("train", "test"):
            folder = Path("set") / part / NAMES[label]
            folder.mkdir(parents=True, exist_ok=True)
            np.save(folder / f"sample_{i}.npy", spikes[: 19 + i].T)
    found = lc.read_recordings("set", split="train")
    assert found.class_names == NAMES
    assert found.labels.tolist() == [0, 1, 2, 0, 1, 2]  # type: ignore[union-attr]
    assert found.spikes.shape == (6, 24, 78)
    assert not found.spikes[0, 19:].any()
    assert locsnn_main(["train", "--data", "set", "--epochs", "1", "-o", "a.pt"]) == 0
    assert "test accuracy" in capsys.readouterr().out
    assert compiled("--events", "set")["classes"] == list(NAMES)


@pytest.mark.parametrize("name", ["b.npz", "b.pt"])
def test_names_of_classes_are_written_again(name: str) -> None:
    assert locsnn_main(["events", write(), "--to", name]) == 0
    assert lc.read_recordings(name).class_names == NAMES


@pytest.mark.parametrize(
    ("order", "shape"),
    [
        pytest.param("samples,steps,channels", (2, 5, 24), id="Python arrays"),
        pytest.param("samples, steps, polarities, rows, columns", (2, 5, 2, 3, 4), id="frames"),
        pytest.param("steps taxels polarities", (5, 12, 2), id="one recording"),
        pytest.param("columns,rows,steps,samples", (4, 3, 5, 2), id="no polarities"),
    ],
)
def test_axes_are_taken_as_said(order: str, shape: tuple[int, ...]) -> None:
    array = np.arange(np.prod(shape)).reshape(shape)
    names = parse_axes(order, "axes")
    found = to_step_major(array, "array", order=names)
    size = dict(zip(names, shape, strict=True))
    assert found.shape == (size.get("samples", 1), 5, np.prod(shape) // 5 // size.get("samples", 1))
    # A place of the array, and where its value must be found.
    at = dict.fromkeys(names, 0) | {name: size[name] - 1 for name in names if name in ("rows", "taxels", "channels")}
    cell = at.get("rows", 0) * size.get("columns", 1) + at.get("columns", 0) + at.get("taxels", 0)
    channel = cell * size.get("polarities", 1) + at.get("channels", 0)
    assert found[0, 0, channel] == array[tuple(at[name] for name in names)]


@pytest.mark.parametrize(
    "order", ["samples,channels", "steps,rows", "steps,channels,taxels", "steps,steps,channels", "time,channels", ""]
)
def test_texts_that_are_no_order_of_axes(order: str) -> None:
    assert refused(parse_axes, order, "axes") == (
        f"axes: it is not an order of axes (got {order!r}). Name steps and channels, or taxels, "
        "or rows and columns, with polarities or without, and samples."
    )


def test_an_array_of_other_axes_than_said() -> None:
    assert refused(to_step_major, np.zeros((2, 3)), "array", order=("samples", "steps", "channels")) == (
        "array: its shape is not one of recordings (2 axes against 3). Give (samples, steps, channels)."
    )
