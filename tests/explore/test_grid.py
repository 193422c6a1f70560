"""The grid of settings follows the table of dials, which agrees with the options of the compiler.

A dial is a choice of the compiler, such as the weight bits, and a setting is one value for each dial.
"""

import argparse
import inspect
from dataclasses import asdict, dataclass

import pytest

import locsnn_compile as lc
from hw_model.arithmetic.fixed_point import WEIGHT_BITS
from locsnn_compile import settings as grid
from locsnn_compile.cli import explore as explore_cli
from locsnn_compile.cli.compile import parser
from locsnn_compile.cli.declarations import explore as declared_options
from locsnn_compile.cli.declarations.shared import add_explored
from locsnn_compile.errors import InputError
from locsnn_compile.explore import result
from locsnn_compile.settings import DIALS, STRATEGIES, Dial, Setting, settings
from tests.support.explored_model import explore, explored, narrow


@pytest.mark.parametrize("dial", DIALS, ids=lambda dial: dial.name)
def test_a_dial_is_an_option_of_the_compiler(dial):
    assert dial.name in inspect.signature(lc.compile).parameters
    assert dial.option in parser().format_help()
    for value in (*dial.values, dial.neutral):
        assert str(
            getattr(parser().parse_args(["m.pt", dial.option, str(value)]), dial.name)
        ) == str(value)


def test_all_strategies_and_widths_are_there():
    strategy, bits = DIALS[:2]
    assert (*strategy.values, strategy.neutral) == (*STRATEGIES, "auto")
    assert bits.values == WEIGHT_BITS


def test_a_setting_says_itself_three_ways(model):
    setting = Setting(*(dial.values[0] for dial in DIALS))
    assert asdict(setting) == {dial.name: dial.values[0] for dial in DIALS}
    assert setting.arguments(lc.load(model))[:4] == ["--strategy", "dendrite", "--weight-bits", "1"]
    assert str(setting).startswith("dendrite, 1-bit")


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.0, ""), (0.07, ", 7% split"), (0.125, ", 12.5% split"), (1.0, ", 100% split")],
)
def test_a_share_of_split_weights_is_said_in_full(share, words):
    assert str(Setting("dendrite", weight_bits=8, split_weights=share)) == f"dendrite, 8-bit{words}"


def test_the_last_axis_is_the_fastest_and_nothing_is_twice(model):
    network = lc.load(model)
    values_to_try = {dial.name: dial.values[:1] for dial in DIALS} | {
        "weight_bits": [4, 8, 4],
        "strategy": ["reset", "dendrite"],
    }
    strategies_and_bits = [setting.values[:2] for setting in settings(network, values_to_try, 8)]
    assert strategies_and_bits == [("reset", 4), ("reset", 8), ("dendrite", 4), ("dendrite", 8)]


def test_options_that_change_nothing_are_not_tried():
    """A network of the chip's integers keeps its neurons and weights as they are."""
    network = lc.load("examples/models/objects-hybrid-loihi.pt")
    (setting,) = settings(network, {}, 8)
    assert [tried.weight_bits for tried in settings(network, {}, 4)] == [4]
    assert setting.values == tuple(dial.neutral for dial in DIALS)
    assert setting.arguments(network) == []


PSI = Dial(
    "psi",
    (5.0, 10.0),
    10.0,
    "populations",
    tried="late predictions",
    help="how late the prediction shifts",
    value="X",
    read=float,
    words="psi {:g}".format,
    bounds=(0.0, 99.0),
)


@dataclass(frozen=True)
class Late(Setting):
    """A setting with a further dial."""

    psi: float = 10.0


def test_a_row_and_its_field_add_a_dial(model, events, tmp_path, monkeypatch):
    """Option, grid, compilation, files and commands follow the table; ``psi`` is an option that changes no figure."""
    for module in (grid, explore_cli, result):
        monkeypatch.setattr(module, "DIALS", (*DIALS, PSI))
    monkeypatch.setattr(declared_options, "DIALS", (*DIALS, PSI))
    monkeypatch.setattr(grid, "Setting", Late)
    words = (*narrow("reset"), "--psi", 5, 10, "--engines", "--quiet")
    assert explore(model, "--events", events, *words, "-o", tmp_path / "out") == 0
    five, ten = explored(tmp_path / "out")["points"]
    assert (five["setting"]["psi"], ten["setting"]["psi"]) == (5.0, 10.0)
    assert five["figures"] == ten["figures"]
    assert " --psi 5.0 --calibration " in five["command"]
    header = (tmp_path / "out/explore.csv").read_text().splitlines()[0].split(",")
    assert header[: len(DIALS) + 1] == [*(dial.name for dial in DIALS), "psi"]
    assert ">psi 5</text>" in (tmp_path / "out/explore.svg").read_text()


@pytest.mark.parametrize(
    ("value", "line"),
    [
        ("0", None),
        ("7.5", None),
        ("99.5", "--psi 99.5: it is out of range. Give a number from 0 to 99."),
    ],
    ids=["least", "between", "too large"],
)
def test_bounds_let_other_values_in(value, line):
    parser = argparse.ArgumentParser()
    add_explored(parser, PSI)
    if line is None:
        assert parser.parse_args(["--psi", value]).psi == [float(value)]
        return
    with pytest.raises(InputError) as caught:
        parser.parse_args(["--psi", value])
    assert str(caught.value) == line


def test_neutral_settings_compile(model, events, tmp_path):
    arguments = [text for dial in DIALS for text in (dial.option, dial.values[0])]
    assert (
        explore(
            model, "--events", events, *arguments, "--engines", "-o", tmp_path / "out", "--quiet"
        )
        == 0
    )
    assert len(explored(tmp_path / "out")["points"]) == 1
