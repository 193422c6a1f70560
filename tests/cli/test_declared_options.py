"""The declarations of options: every command has them, help texts have one form, and values are parsed or refused."""

import argparse
from pathlib import Path

import pytest

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.main import COMMANDS
from locsnn_compile.cli.options import DECLARATIONS, add_options
from locsnn_compile.errors import InputError

ROOT = Path(__file__).parents[2]


def test_every_command_has_its_declarations_and_no_other():
    folder = ROOT / "locsnn_compile/cli/declarations"
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__", "kinds", "shared"}
    assert set(DECLARATIONS) == modules == {*COMMANDS, "sim", "fit", "stream"}


@pytest.mark.parametrize("command", DECLARATIONS)
def test_every_option_has_a_help_that_fits_into_a_sentence(command):
    parser = argparse.ArgumentParser(prog=command)
    add_options(parser, command)
    for action in parser._actions:
        assert action.help
        assert "  " not in action.help
        assert not action.help.endswith(".")


@pytest.mark.parametrize(
    ("limits", "good", "bad", "accepted"),
    [
        ({}, "-3.5", "inf", "a finite number"),
        ({"low": 0}, "0", "-1", "a number from 0 up"),
        ({"low": 0, "high": 1}, "1", "1.5", "a number from 0 to 1"),
        ({"above": 0}, "0.1", "0", "a number above 0"),
        ({"low": 0}, "2", "nan", "a number from 0 up"),
    ],
    ids=["finite", "from", "from to", "above", "not a number"],
)
def test_numbers_keep_their_limits(limits, good, bad, accepted):
    parse = number("--x", float, **limits)
    assert parse(good) == float(good)
    with pytest.raises(InputError) as caught:
        parse(bad)
    assert str(caught.value) == f"--x {bad}: it is out of range. Give {accepted}."


@pytest.mark.parametrize(
    ("known", "parse", "bad", "message"),
    [
        (("fast", "slow"), str, "slw", "--x slw: it is not known. Did you mean 'slow'?"),
        (("1", "8"), int, "7", "--x 7: it is not known. Choose from 1, 8."),
    ],
    ids=["names", "numbers"],
)
def test_choices_refuse_other_values(known, parse, bad, message):
    arguments = choice("--x", known, parse)
    assert arguments["choices"] == [parse(text) for text in known]
    with pytest.raises(InputError) as caught:
        arguments["type"](bad)
    assert str(caught.value) == message
