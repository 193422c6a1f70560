"""Options of ``locsnn events``, in the order of its help."""

import argparse
from pathlib import Path

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    EVENT_FILES,
    add_division,
    add_json,
    add_sensor,
    add_times,
)
from locsnn_compile.data.formats import EVENT_FORMATS


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn events``."""
    event_files = ", ".join(row.suffix for row in EVENT_FORMATS if row.write)
    parser.add_argument(
        "file",
        metavar="FILE",
        help=f"recordings: {EVENT_FILES}",
    )
    parser.add_argument(
        "--part",
        metavar="NAME",
        **choice("--part", ("train", "test")),
        help="train or test of a divided archive or folder (default test)",
    )
    add_times(parser)
    add_division(parser)
    add_sensor(parser)
    parser.add_argument(
        "--encode",
        metavar="KIND",
        **choice("--encode", ("rate", "latency", "levels")),
        help="FILE holds numbers: encode them by rate, latency (both with --steps) or levels",
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, help="with --encode rate: the seed of chance (default 0)"
    )
    parser.add_argument(
        "--level",
        metavar="X",
        type=number("--level", float, above=0),
        help="with --encode levels: by how much a signal moves for a spike",
    )
    parser.add_argument(
        "--recording", metavar="K", type=int, help="the recording of the raster, from 0 (default 0)"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE.svg", type=Path, help="write the raster as a picture"
    )
    parser.add_argument(
        "--to",
        metavar="OUT",
        type=Path,
        help=f"write the recordings: .npz, .npy, .pt, {event_files}, .zip, folder",
    )
    parser.add_argument(
        "--members",
        metavar="KIND",
        default="npy",
        help="with --to a folder or .zip: the format of its files (default npy)",
    )
    parser.add_argument(
        "--structured",
        action="store_true",
        help="with --to .npy or .npz: one recording as fields t, x, p",
    )
    add_json(parser, "print the figures as JSON, and nothing else")
