"""The table of emitters: each kind writes only its own files, and is refused for a build that lacks what it shows."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.emitters import EMITTERS, ShownRecording, bench_files

MODEL = Path(__file__).parents[2] / "examples/models/containers-window-16.pt"


@pytest.fixture(scope="module")
def compiled() -> lc.CompiledModel:
    """A shipped network, checked on a recording without events."""
    network = lc.load(MODEL)
    spikes = np.zeros((1, network.steps, network.channels), np.uint8)
    return lc.compile(network, events=spikes, diagnosis=False)


def test_no_two_emitters_share_a_kind_or_a_file():
    kinds = Counter(emitter.kind for emitter in EMITTERS)
    paths = Counter(emitter.path.strip("/") for emitter in EMITTERS)
    assert max(kinds.values()) == 1
    assert max(paths.values()) == 1


@pytest.mark.parametrize(
    "kind", [e.kind for e in EMITTERS if e.shows_recording and e.of_chip is None]
)
def test_a_kind_that_shows_a_recording_is_refused_without_one(compiled, kind):
    with pytest.raises(lc.InputError) as caught:
        compiled.files([kind])
    assert str(caught.value) == "emit: it shows a recording, and none is given. Give one."


@pytest.mark.parametrize("kind", ["network", "nir", "csv", "viewer"])
def test_a_kind_that_shows_a_model_is_refused_for_a_program_written_by_hand(compiled, kind):
    with pytest.raises(lc.InputError) as caught:
        bench_files(compiled.program, [kind], np.zeros((1, 1), np.uint8))
    message = "emit: it shows a model, and the program was written by hand. Compile a model."
    assert str(caught.value) == message


WRITABLE = [
    emitter
    for emitter in EMITTERS
    if emitter.kind not in ("nir", "net", "lava") and not emitter.of_chip
]
"""All emitters except formats that cannot hold this model, and those for other chips."""


@pytest.mark.parametrize("emitter", WRITABLE, ids=lambda emitter: emitter.kind)
def test_an_emitter_writes_its_own_path_alone(compiled, emitter):
    spikes = np.zeros((1, compiled.network.steps, compiled.network.channels), np.uint8)
    shown = ShownRecording(spikes[0])
    names = set(compiled.files([emitter.kind], shown)) - set(compiled.files())
    if emitter.path.endswith("/"):
        assert names
        assert all(name.startswith(emitter.path) for name in names)
    else:
        assert names == {emitter.path}
