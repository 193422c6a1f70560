"""Options that several commands share: one function for each group of options.

An option that was not given is None in the parsed arguments, so that the commands know whether to
look for the value in the model or in the recordings; help texts say the default.
"""

import argparse
from collections.abc import Callable
from typing import Any

from locsnn_compile.cli.completion import chips
from locsnn_compile.cli.declarations.kinds import choice, number, numbers, start
from locsnn_compile.frontends.formats import FORMAT_OPTIONS
from locsnn_compile.settings import Dial

DEFAULT_TARGET = "loihi-sim"
"""The chip that commands take if none is given."""


def add_times(parser: argparse.ArgumentParser) -> None:
    """Add the options on how events become bins: steps of one width, and which class is which."""
    parser.add_argument(
        "--step-seconds",
        metavar="X",
        type=number("--step-seconds", float, above=0),
        help=(
            "width of a bin in seconds, if the recordings do not give it (default: the "
            "model's, else 0.02)"
        ),
    )
    parser.add_argument(
        "--steps",
        metavar="N",
        type=int,
        help="steps of a recording: shorter ones end in silence, longer ones are cut",
    )
    parser.add_argument(
        "--threshold",
        metavar="N",
        type=int,
        help="events that a bin must exceed to be 1 (default 0)",
    )
    parser.add_argument(
        "--start",
        metavar="WHEN",
        type=start,
        help=(
            "seconds at which step 0 of events begins, or first: at the first event "
            "(default: the model's, else as the format has it)"
        ),
    )
    parser.add_argument(
        "--time-unit",
        metavar="UNIT",
        **choice("--time-unit", ("ns", "us", "ms", "s")),
        help=(
            "unit of t in fields and tables, and of spike times in HDF5 (default: the "
            "model's, else us, in HDF5 s)"
        ),
    )
    parser.add_argument(
        "--max-steps",
        metavar="N",
        type=number("--max-steps", int, low=1),
        help="longest recording of events to read, in steps (default 20000)",
    )
    parser.add_argument(
        "--classes",
        metavar="NAMES",
        help=(
            "names of the classes from class 0 on, separated by commas (default: the "
            "model's, the file's or a known order)"
        ),
    )


def add_division(parser: argparse.ArgumentParser) -> None:
    """Add the options on how recordings are divided into a train part and a test part."""
    parser.add_argument(
        "--split",
        metavar="X",
        type=float,
        help="share of each class to test on, such as 0.2, if there are no parts",
    )
    parser.add_argument(
        "--fold",
        metavar="K",
        type=int,
        help="round of --split, or number of VT_SNN's train_80_20_K.txt (default 1)",
    )


def add_sensor(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe the sensor, and those that select or merge its channels."""
    parser.add_argument(
        "--axes",
        metavar="ORDER",
        help="axes of arrays, such as samples,steps,channels (default samples,channels,steps)",
    )
    parser.add_argument(
        "--grid",
        metavar="WxH",
        help="the sensor is a grid of W columns and H rows, numbered row by row",
    )
    parser.add_argument(
        "--layout",
        metavar="FILE.yaml",
        help=(
            "the sensor is described in this file: name, polarities, positions and names of taxels"
        ),
    )
    parser.add_argument(
        "--channels",
        metavar="N",
        type=number("--channels", int, low=1),
        help="the sensor has N channels, without positions or in --columns",
    )
    parser.add_argument(
        "--polarities",
        metavar="N",
        type=int,
        help=(
            "polarities that the sensor has, 1 or 2 (default: 2 for a grid, 1 for "
            "channels, else as in the events)"
        ),
    )
    parser.add_argument(
        "--columns",
        metavar="N",
        type=number("--columns", int, low=1),
        help="columns of the grid of x and y (default: the highest x plus 1)",
    )
    parser.add_argument(
        "--merge-polarities",
        action="store_true",
        default=None,
        help="make one channel of both polarities of a pixel",
    )
    parser.add_argument(
        "--only-taxels",
        metavar="NUMBERS",
        help="read these taxels alone, such as 13-24 or 1,5,9",
    )
    parser.add_argument(
        "--only-polarity",
        metavar="N",
        type=number("--only-polarity", int, low=0, high=1),
        help="read this polarity alone: 0 (rising) or 1 (falling)",
    )
    parser.add_argument(
        "--merge-channels",
        metavar="N",
        type=number("--merge-channels", int, low=1),
        help="make N channels of neighbouring ones, each 1 where any of them is",
    )


def add_numbering(parser: argparse.ArgumentParser) -> None:
    """Add the options on how a model numbers its inputs."""
    parser.add_argument(
        "--channel-order",
        metavar="ORDER",
        **choice("--channel-order", ("yxp", "pyx")),
        help=(
            "how the model numbers its inputs, if it does not say so: yxp (2 * pixel + "
            "polarity), or pyx, as images (C, H, W)"
        ),
    )


def add_weights(parser: argparse.ArgumentParser) -> None:
    """Add the options on the weights of several models."""
    parser.add_argument(
        "--weights",
        metavar="X,Y,...",
        type=numbers,
        help=(
            "weights of the models' class scores (default: chosen so that all weighted "
            "scores vary equally)"
        ),
    )


EVENT_FILES = ".zip, folder, .npy, .npz, .pt, .h5, or event files"
"""The kinds of files from which recordings are read, in the words of the help."""


def add_program(parser: argparse.ArgumentParser) -> None:
    """Add the argument for a build whose program is played."""
    parser.add_argument("program", metavar="DIR", help="folder that locsnn-compile wrote")


def add_played(parser: argparse.ArgumentParser) -> None:
    """Add the options on what is played: a program and recordings."""
    add_program(parser)
    add_recordings(parser, "--events", f"recordings: {EVENT_FILES}", required=True)


def add_recordings(
    parser: argparse.ArgumentParser, option: str, help: str, *, required: bool = False
) -> None:
    """Add an option that names recordings."""
    parser.add_argument(option, metavar="FILE", required=required, help=help)


def add_profile(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the option on what operations cost."""
    parser.add_argument("--profile", metavar="NAME|FILE", help=help)


def add_psi(parser: argparse.ArgumentParser, help: str) -> None:
    """Add psi of the time-weighted prediction: how late it shifts to the location branch."""
    parser.add_argument("--psi", metavar="X", type=number("--psi", float, low=0), help=help)


def add_least_agreement(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the bound on the share of recordings whose prediction must stay the same."""
    parse_share = number("--min-agreement", float, low=0, high=1)
    parser.add_argument("--min-agreement", metavar="X", type=parse_share, help=help)


def add_error_bounds(
    parser: argparse.ArgumentParser, *, agreement: str, spikes: str, scores: str
) -> None:
    """Add the bounds on what the chip may lose of the float network, with a help text for each."""
    add_least_agreement(parser, agreement)
    parse_share = number("--max-spike-error", float, low=0, high=1)
    parser.add_argument("--max-spike-error", metavar="X", type=parse_share, help=spikes)
    # Without an upper bound: it is relative to the spread of the scores, and may exceed 1.
    parse_error = number("--max-score-error", float, low=0)
    parser.add_argument("--max-score-error", metavar="X", type=parse_error, help=scores)


def add_scheduler(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the option that leaves the work to a Dask cluster."""
    parser.add_argument("--scheduler", metavar="ADDRESS", help=help)


def add_folder(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option for the folder to write."""
    help = f"folder to write (default {default})"
    parser.add_argument("-o", "--output", metavar="DIR", help=help)


def add_json(parser: argparse.ArgumentParser, help: str = "print the result as JSON") -> None:
    """Add the option that prints JSON."""
    parser.add_argument("--json", action="store_true", help=help)


def add_document(parser: argparse.ArgumentParser, name: str) -> None:
    """Add ``--json``, which prints the file ``name`` that the command also writes."""
    add_json(parser, f"print {name} to standard output, and nothing else there")


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add the option that prints nothing."""
    parser.add_argument("--quiet", action="store_true", help="print nothing")


def add_chip(
    parser: argparse.ArgumentParser,
    option: str,
    help: str,
    default: str | None = None,
    completer: Callable[..., list[str]] = chips,
) -> None:
    """Add an option that names a chip; shells complete the names of the included chips."""
    action = parser.add_argument(option, metavar="CHIP", default=default, help=help)
    # argcomplete looks for this attribute, which argparse does not declare.
    action.completer = completer  # type: ignore[attr-defined]


def add_chips(parser: argparse.ArgumentParser, option: str, help: str) -> None:
    """Add an option that names a chip and can be given several times."""
    action = parser.add_argument(option, metavar="CHIP", action="append", help=help)
    action.completer = chips  # type: ignore[attr-defined]


def add_format_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that only some formats of models take."""
    for option in FORMAT_OPTIONS:
        name = f"--{option.name.replace('_', '-')}"
        if not option.value:  # a flag; None instead of False says that it was not given
            parser.add_argument(name, action="store_true", default=None, help=option.help)
        elif option.is_number:
            parse = number(name, float)
            parser.add_argument(name, metavar=option.value, type=parse, help=option.help)
        else:
            parser.add_argument(name, metavar=option.value, help=option.help)


def add_dial(parser: argparse.ArgumentParser, dial: Dial) -> None:
    """Add the option of ``locsnn-compile`` for one value of a dial (see ``settings.py``)."""
    kind: dict[str, Any] = {"type": dial.read}
    if dial.choices:
        kind = choice(dial.option, dial.choices)
    elif dial.bounds is not None:
        low, high = dial.bounds
        kind = {"type": number(dial.option, dial.read, low=low, high=high)}
    parser.add_argument(
        dial.option, metavar=dial.value, default=dial.default, help=dial.help, **kind
    )


def add_explored(parser: argparse.ArgumentParser, dial: Dial) -> None:
    """Add the option of ``locsnn explore`` for several values of a dial.

    Without bounds only the usual values can be tried; with bounds, any value between them.
    """
    usual_values = tuple(map(str, dial.values))
    if dial.bounds is None:
        kind = choice(dial.option, usual_values, read=type(dial.values[0]))
    else:
        low, high = dial.bounds
        kind = {"type": number(dial.option, dial.read, low=low, high=high)}
    help = f"{dial.tried} to try (default: {', '.join(usual_values)})"
    parser.add_argument(dial.option, metavar="X", nargs="+", help=help, **kind)
