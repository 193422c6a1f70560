"""Python, the command line and explore make the same compile request from the same options.

Tests replace ``fulfil``, which compiles, and look at the request that it gets.
"""

from dataclasses import dataclass, replace

import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile import api
from locsnn_compile import settings as settings_module
from locsnn_compile.cli import build
from locsnn_compile.cli.compile import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.explore import point
from locsnn_compile.explore.point import Study
from locsnn_compile.request.compile_request import CompileRequest
from locsnn_compile.settings import DIALS, Dial, Setting, setting_for
from tests.support.networks import hybrid, recordings

CHIP = hw.chip("loihi-sim")
ASKED = {"strategy": "delay-line", "weight_bits": 4, "split_weights": 0.5}
OPTIONS = ["--strategy", "delay-line", "--weight-bits", "4", "--split-weights", "0.5"]


class StoppedError(Exception):
    """Raised in place of compiling, with the request."""

    def __init__(self, request: CompileRequest) -> None:
        self.request = request


def stop(request):
    """Stand in for ``fulfil``."""
    raise StoppedError(request)


def requested(call):
    """Return the request that a call makes."""
    with pytest.raises(StoppedError) as caught:
        call()
    return caught.value.request


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons."""
    return hybrid(1, steps=20, hidden=4)


@pytest.fixture(scope="module")
def played(network):
    """Two random recordings."""
    return Recordings(recordings(network, samples=2), labels=None, step_seconds=None, source="few")


@pytest.fixture
def by_python(network, played, monkeypatch):
    """The request that ``lc.compile`` makes."""
    monkeypatch.setattr(api, "fulfil", stop)
    return requested(lambda: lc.compile(network, "loihi-sim", events=played, **ASKED))


def test_python_asks_for_the_setting_that_is_given(by_python, network, played):
    assert by_python.network is network
    assert by_python.chip == CHIP
    assert by_python.setting.setting == Setting("delay-line", weight_bits=4, split_weights=0.5)
    assert by_python.setting.given == {"strategy", "weight_bits", "split_weights"}
    assert not by_python.setting.chooses
    assert by_python.check.events is played
    assert by_python.check.diagnosis


def test_the_command_line_asks_for_the_same_as_python(by_python, played, tmp_path, monkeypatch):
    monkeypatch.setattr(build, "fulfil", stop)
    monkeypatch.setattr(build, "read_network", lambda args: by_python.network)
    monkeypatch.setattr(
        build, "check_and_calibration_recordings", lambda args, network: (played, None)
    )
    request = requested(lambda: main(["m.pt", "-o", str(tmp_path / "b"), "--quiet", *OPTIONS]))
    for name in ("network", "chip", "pricing"):
        assert getattr(request, name) == getattr(by_python, name)
    assert vars(request.setting) == vars(by_python.setting)
    assert vars(request.check) == vars(by_python.check)


def test_explore_asks_for_the_same_as_python_without_a_diagnosis(by_python, network, played):
    request = Study(network, "digest", CHIP, played, played).request(Setting(**ASKED))
    assert vars(request.setting) == {**vars(by_python.setting), "calibration": played}
    assert vars(request.check) == {**vars(by_python.check), "diagnosis": False}


def test_by_default_weights_are_the_widest_of_the_chip_and_none_is_split():
    assert setting_for(CHIP, {}) == Setting("auto", weight_bits=8, split_weights=0.0)
    narrow = hw.chip("tiny-sim")
    assert setting_for(narrow, {}).weight_bits == narrow.registers.weight_bits[-1]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            {"strategy": "dendrit"},
            "strategy 'dendrit': unknown lowering strategy. Did you mean 'dendrite'?",
        ),
        (
            {"split_weights": 2.0},
            "split_weights: it is out of range (got 2.0 against 0..1). Correct the number.",
        ),
        (
            {"weight_bits": 7},
            "--weight-bits: no synapse format has 7 bits. Choose one of 1, 2, 3, 4, 5, 6, 8.",
        ),
    ],
    ids=["strategy", "share", "bits"],
)
def test_values_that_no_chip_has_are_refused(asked, message):
    with pytest.raises(InputError) as caught:
        setting_for(CHIP, asked)
    assert str(caught.value) == message


def test_weights_wider_than_the_chip_make_a_refused_point(network, played):
    chip = replace(CHIP, registers=replace(CHIP.registers, weight_bits_max=4))
    study = Study(network, "digest", chip, played, played)
    refused = point.measure(study, Setting("reset", weight_bits=8)).refused
    assert isinstance(refused, TargetError)
    assert str(refused) == (
        "--weight-bits: weights of 8 bits are too wide (loihi-sim has weight_bits_max 4). "
        "Ask for 4, or leave it out."
    )
    assert point.measure(study, Setting("reset", weight_bits=4)).refused is None


# A dial that the compiler does not have, to test what a new row of DIALS brings.
HEADROOM = Dial(
    "headroom",
    values=(8.0, 16.0),
    neutral=16.0,
    needs="has_float_weights",
    tried="thresholds that the voltage register holds",
    help="thresholds that the voltage register holds (default 16)",
    value="X",
    read=float,
    bounds=(1.0, 64.0),
)


@dataclass(frozen=True)
class SettingWithHeadroom(Setting):
    """A setting with a value for the dial :data:`HEADROOM`."""

    headroom: float = 16.0


@pytest.mark.parametrize(("given", "headroom"), [({}, 16.0), ({"headroom": 8.0}, 8.0)])
def test_a_dial_and_its_field_are_a_keyword_of_compile(
    network, played, given, headroom, monkeypatch
):
    monkeypatch.setattr(settings_module, "DIALS", (*DIALS, HEADROOM))
    monkeypatch.setattr(settings_module, "Setting", SettingWithHeadroom)
    monkeypatch.setattr(api, "fulfil", stop)
    request = requested(lambda: lc.compile(network, events=played, **ASKED, **given))
    assert request.setting.setting == SettingWithHeadroom(**ASKED, headroom=headroom)
    assert request.setting.given == {*ASKED, *given}


def test_a_value_out_of_the_bounds_of_a_dial_is_refused(network, played, monkeypatch):
    monkeypatch.setattr(settings_module, "DIALS", (*DIALS, HEADROOM))
    monkeypatch.setattr(settings_module, "Setting", SettingWithHeadroom)
    with pytest.raises(InputError) as caught:
        lc.compile(network, events=played, headroom=99.0)
    assert str(caught.value) == (
        "headroom: it is out of range (got 99.0 against 1.0..64.0). Correct the number."
    )


def test_a_keyword_that_is_no_dial_is_refused_as_python_does(network):
    with pytest.raises(TypeError) as caught:
        lc.compile(network, headroom=8.0)
    assert str(caught.value) == "compile() got an unexpected keyword argument 'headroom'"


def test_a_dial_of_another_type_is_refused_by_name(network):
    with pytest.raises(InputError) as caught:
        lc.compile(network, headroom=[8.0])
    assert str(caught.value) == (
        "compile, headroom: it must be a str, int or float (got list [8.0]). Correct it."
    )
