"""Descriptions of FPGA boards: the ones that ship, one of a user, and every mistake with its whole message.

Dividers of PLLs are compared with values computed by hand from the data sheets' formulas.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

import hw_model as hw
from hw_model.description.board import board, parse_board
from hw_model.description.boards import BOARDS
from hw_model.description.pll import Ecp5Pll, Ice40Pll, ecp5_pll, ice40_pll

OWN = {
    "name": "my-board",
    "device": {"family": "ecp5", "size": "25k", "package": "CABGA256", "speed": 7},
    "clock": {"pin": "A7", "mhz": 12, "core_mhz": 60},
    "serial": {"rx": "R3", "tx": "T3"},
    "leds": {"loaded": {"pin": "B1", "active": "low"}},
}


@pytest.mark.parametrize("name", BOARDS)
def test_a_board_that_ships_is_a_description_for_its_target(name: str) -> None:
    described = board(name)
    assert (described.name, described.target) == (name, BOARDS[name])


# By hand. 25 MHz * 24 = 600 MHz, / 6 = 100 MHz. 25 MHz * 26 = 650 MHz, / 8 = 81.25 MHz; it could be 75 MHz * n / m only
# with an oscillator of 487.5 MHz, further from 600 MHz. 12 MHz * 50 = 600 MHz, / 10 = 60 MHz.
# 100 MHz / 2 * 13 = 650 MHz, / 10 = 65 MHz: at 100 MHz undivided, no oscillator from 400 to 800 MHz is a multiple of 65 MHz.
ECP5 = {
    "ULX3S-25F": (25.0, 100.0, (1, 24, 6)),
    "ULX3S-85F": (25.0, 81.25, (1, 26, 8)),
    "12 MHz": (12.0, 60.0, (1, 50, 10)),
    "divided input": (100.0, 65.0, (2, 13, 10)),
}


@pytest.mark.parametrize(("input_mhz", "core_mhz", "dividers"), ECP5.values(), ids=ECP5)
def test_the_dividers_of_an_ecp5_equal_those_worked_out_by_hand(
    input_mhz, core_mhz, dividers
) -> None:
    pll = ecp5_pll(input_mhz, core_mhz, "x")
    assert pll == Ecp5Pll(Fraction(input_mhz), *dividers)
    assert pll.output_mhz == Fraction(core_mhz)


class Ice40Case(NamedTuple):
    """A PLL of an iCE40: its clocks, the dividers by hand (divr, divf, divq), and the range of its filter."""

    input_mhz: float
    core_mhz: float
    dividers: tuple[int, int, int]
    filter_range: int


# By hand. 12 MHz * 64 = 768 MHz, / 2^5 = 24 MHz, filter 1 up to 17 MHz. 48 MHz / 4 * 55 = 660 MHz, / 2^5 = 20.625 MHz.
# 100 MHz * 8 = 800 MHz, / 2^5 = 25 MHz, and 800 MHz is the only multiple of 25 by a power of two from 533 to 1066 MHz; undivided
# or not, it is the same frequency, and the first reference divider is taken: filter 5 up to 101 MHz.
ICE40 = {
    "iCEBreaker": Ice40Case(input_mhz=12.0, core_mhz=24.0, dividers=(0, 63, 5), filter_range=1),
    "48 MHz": Ice40Case(input_mhz=48.0, core_mhz=20.625, dividers=(3, 54, 5), filter_range=1),
    "100 MHz": Ice40Case(input_mhz=100.0, core_mhz=25.0, dividers=(0, 7, 5), filter_range=5),
}


@pytest.mark.parametrize(
    ("input_mhz", "core_mhz", "dividers", "filter_range"), ICE40.values(), ids=ICE40
)
def test_the_dividers_of_an_ice40_equal_those_worked_out_by_hand(
    input_mhz, core_mhz, dividers, filter_range
) -> None:
    pll = ice40_pll(input_mhz, core_mhz, "x")
    assert pll == Ice40Pll(Fraction(input_mhz), *dividers)
    assert (pll.output_mhz, pll.filter_range) == (Fraction(core_mhz), filter_range)


def written(folder: Path, **changes: object) -> str:
    """Write a description in which keys such as ``clock__mhz`` have other values, and return its path."""
    described = yaml.safe_load(yaml.safe_dump(OWN))
    for path, value in changes.items():
        *groups, key = path.split("__")
        group = described
        for name in groups:
            group = group[name]
        group[key] = value
    (folder / "own.yaml").write_text(yaml.safe_dump(described))
    return str(folder / "own.yaml")


def test_a_users_board_takes_the_core_of_its_size(tmp_path: Path) -> None:
    own = board(written(tmp_path))
    assert (own.target, own.serial.baud, own.clock.core) == ("ecp5-25f", 1_000_000, 60.0)


def test_the_board_in_the_manual_is_a_valid_description() -> None:
    page = Path(__file__).parents[2] / "docs/how-to/put-a-model-on-a-board.md"
    own_board = page.read_text("utf-8").partition("## A board of your own\n")[2]
    text = own_board.split("```text\n")[1].split("```")[0]
    described = parse_board(text, "page")
    assert (described.name, described.clock.core, list(described.lights)) == (
        "my-board",
        60.0,
        ["loaded", "failed"],
    )


ICE = {"family": "ice40", "size": "up5k", "package": "sg48"}
ICE_PINS = {"device": ICE, "clock__pin": 35, "serial": {"rx": 6, "tx": 9}, "leds": {}}
REFUSED = {
    "family": ({"device__family": "xc7"}, "device.family: 'xc7' is not known. Choose one of: ecp5, ice40."),
    "size": ({"device__size": "26k"}, "device.size: the core cannot go to ecp5 of the size '26k'. Did you mean '25k'?"),
    "package": ({"device__package": "CABGA554"}, "device.package: 25k has no package 'CABGA554'. Did you mean 'CABGA256'?"),
    "speed": ({"device__speed": 9}, "device.speed: it must be a whole number from 6 to 8 (got 9). Correct it."),
    "speed of an iCE40": ({"device": {**ICE, "speed": 6}}, "device.speed: an iCE40 has no speed grade. Leave it out."),
    "missing": ({"serial": {"rx": "R3"}}, "serial: the key 'tx' is missing. Add it."),
    "unknown": ({"led": "B1"}, "unknown key 'led'. Did you mean 'leds'?"),
    "frequency": ({"clock__core_mhz": 61.7}, "clock.core_mhz: the PLL cannot make 61.7 MHz from 12 MHz (the nearest is 61.714286 MHz). Give 61.714286."),
    "slow clock": ({"clock__mhz": 5}, "clock.core_mhz: the PLL cannot make 60 MHz from 5 MHz. Leave it out, to use the clock of the board."),
    "frequency of an iCE40": ({**ICE_PINS, "clock__mhz": 12, "clock__core_mhz": 25}, "clock.core_mhz: the PLL cannot make 25 MHz from 12 MHz (the nearest is 25.125 MHz). Give 25.125."),
    "slow clock of an iCE40": ({**ICE_PINS, "clock__mhz": 5, "clock__core_mhz": 24}, "clock.core_mhz: the PLL cannot make 24 MHz from 5 MHz. Leave it out, to use the clock of the board."),
    "clock out of range": ({"clock__core_mhz": 500}, "clock.core_mhz: it must be a number from 1 to 400 (got 500). Correct it."),
    "no pin": ({"serial__rx": "pin 3"}, "serial.rx: 'pin 3' is not a pin. Give a site of the package, such as G2 or 35."),
    "pin twice": ({"serial__rx": "T3"}, "serial.tx: pin T3 is that of serial.rx already. Give each signal a pin of its own."),
    "low line": ({"serial__rx": {"pin": "R3", "active": "low"}}, "serial.rx: only a light or the reset can be active low. Leave 'active' out."),
    "pull": ({"device": ICE, "clock__core_mhz": 24, "reset": {"pin": 10, "pull": "down"}, "clock__pin": 35, "serial": {"rx": 6, "tx": 9}, "leds": {}}, "reset: a pin of an iCE40 has no 'pull: down'. Leave it out."),
    "fast line": ({"serial__baud": 8_000_000}, "serial.baud: it is too fast for a core of 60 MHz (8000000 against 7500000 bits per second). Lower it."),
    "odd line": ({"serial__baud": 7_000_000}, "serial.baud: a core of 60 MHz cannot keep it (6666667 against 7000000 bits per second, more than 2 % apart). Give 6666667 or a lower rate."),
    "held": ({"held_high": {"clk12": "P1"}}, "held_high: 'clk12' is no name for a pin. Give a name of a-z, 0-9 and '_', which no other signal has."),
    "shipped name": ({"name": "icebreaker"}, "name: a board of the name 'icebreaker' ships. Give it another name."),
    "path as name": ({"name": "../x"}, "name: it must be text of a-z, 0-9 and '-', at most 40 characters (got '../x'). Correct it."),
    "two lines": ({"description": "a\nb"}, "description: it must be text of letters, digits and ' ,.()/+-', at most 100 characters (got 'a\\nb'). Correct it."),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_a_mistake_in_a_board_is_one_line(tmp_path: Path, changes, message) -> None:
    with pytest.raises(hw.InputError) as caught:
        board(written(tmp_path, **changes))
    assert str(caught.value) == f"own.yaml: {message}"
