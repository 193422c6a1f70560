"""Options of ``locsnn train``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    EVENT_FILES,
    add_chip,
    add_division,
    add_quiet,
    add_recordings,
    add_sensor,
    add_times,
)
from locsnn_compile.errors import listed
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.settings import TRAINABLE


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn train``."""
    strategies = listed([f"{TRAINABLE[0]} (default)", *TRAINABLE[1:]], "or")
    add_recordings(parser, "--data", f"recordings: {EVENT_FILES}", required=True)
    add_sensor(parser)
    parser.add_argument(
        "--defaults",
        metavar="NAME",
        help=(
            "data: options left out are chosen from the train part (default), or fixed: "
            "those of the reference"
        ),
    )
    parser.add_argument(
        "--model", metavar="NAME", help=f"{', '.join(ARCHITECTURES)} (default: chosen)"
    )
    parser.add_argument(
        "--optimizer",
        metavar="NAME",
        help="adamw, rmsprop, sgd, or prototypes for window-snn (default: chosen)",
    )
    parser.add_argument(
        "--order",
        metavar="ORDER",
        help=(
            "loop (default: as numbered), reverse, raster, snake, spiral, hilbert, tour, "
            "arch or whorl (NeuTouch), or taxel numbers separated by commas, or a .txt "
            "file of them"
        ),
    )
    parser.add_argument(
        "--delays",
        metavar="STEPS",
        help="delays of synapses onto the time branch, such as '0 20 40' (default 0)",
    )
    parser.add_argument(
        "--config",
        metavar="FILE.yaml",
        help="YAML file of training options; the command line takes precedence",
    )
    add_times(parser)
    add_division(parser)
    parser.add_argument(
        "--epochs",
        metavar="N",
        type=int,
        help="epochs of the schedule (default 250, or 1 for prototypes)",
    )
    parser.add_argument(
        "--batch-size", metavar="N", type=int, help="recordings of an update (default 16)"
    )
    parser.add_argument(
        "--theta",
        metavar="X",
        type=float,
        help="threshold of spike response neurons (default 10, or 2 for short recordings)",
    )
    parser.add_argument(
        "--window-steps", metavar="N", type=int, help="steps of a window (default: chosen)"
    )
    parser.add_argument(
        "--window-stride",
        metavar="N",
        type=int,
        help="steps from a window to the next (default: chosen)",
    )
    parser.add_argument(
        "--window-levels",
        metavar="NUMBERS",
        help="numbers of events to tell apart in a window, such as '1 2' (default: chosen)",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=int,
        help="seed of weights, split, order and dropout (default 0)",
    )
    parser.add_argument(
        "--device", metavar="NAME", help="cpu (default), or cuda for matrix products on a GPU"
    )
    parser.add_argument(
        "--hidden",
        metavar="N",
        type=int,
        help="hidden neurons per branch (default 32; 128 with a graph)",
    )
    parser.add_argument(
        "--graph",
        metavar="NAME",
        help="how a graph joins taxels: manual (default), nearest or tree",
    )
    parser.add_argument("--loss", metavar="NAME", help="cross-entropy (default) or spike-count")
    parser.add_argument(
        "--lambda",
        metavar="X",
        type=float,
        dest="location_weight",
        help="weight of location spikes in the loss",
    )
    parser.add_argument(
        "--class-weights",
        metavar="NAME",
        help="equal, or balanced: rare classes count for more in the loss (default: chosen)",
    )
    parser.add_argument(
        "--tie",
        metavar="CLASS",
        help=(
            "class, by name or number, that equal scores of all classes predict, as in "
            "silence (default: none)"
        ),
    )
    parser.add_argument(
        "--learning-rate",
        metavar="X",
        type=float,
        help="largest learning rate (default: by the number of updates, 0.003 to 0.1)",
    )
    parser.add_argument(
        "--event-dropout",
        metavar="X",
        type=float,
        help="largest share of events to drop (default 0.5, or none for prototypes)",
    )
    parser.add_argument(
        "--channel-dropout",
        metavar="X",
        type=float,
        help="largest share of channels to drop (default 0.3, or none for prototypes)",
    )
    parser.add_argument(
        "--validation-fraction",
        metavar="X",
        type=float,
        help="share of the train part held out to choose the epoch (default 0.125)",
    )
    parser.add_argument(
        "--refit",
        action=argparse.BooleanOptionalAction,
        help="train again on the whole train part once the epoch is chosen (default: yes)",
    )
    parser.add_argument(
        "--recordings",
        metavar="N",
        type=number("--recordings", int, low=0),
        default=8,
        help="recordings to keep in the checkpoint (default 8)",
    )
    add_chip(parser, "--target", "train on the integers of this chip (default: float)")
    parser.add_argument(
        "--strategy",
        metavar="NAME",
        **choice("--strategy", TRAINABLE),
        help=f"with --target: {strategies}",
    )
    parser.add_argument(
        "--weight-bits",
        metavar="N",
        type=int,
        help="with --target: 1 to 6, or 8 (default: the chip's widest)",
    )
    parser.add_argument(
        "--from",
        metavar="MODEL.pt",
        dest="from_model",
        help="start from the weights of this checkpoint",
    )
    parser.add_argument(
        "--resume", action="store_true", help="resume from OUT.pt.state a run that was stopped"
    )
    parser.add_argument(
        "--tensorboard",
        metavar="DIR",
        help="also log every epoch for TensorBoard (needs tensorboard)",
    )
    add_quiet(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.pt",
        default="model.pt",
        help="checkpoint to write (default model.pt)",
    )
