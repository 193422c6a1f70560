"""Options of ``locsnn diff``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.shared import add_json


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn diff``."""
    parser.add_argument("before", metavar="BUILD_A", help="folder that locsnn-compile wrote")
    parser.add_argument("after", metavar="BUILD_B", help="another such folder")
    parser.add_argument(
        "--all", action="store_true", help="print every figure that differs, one per line"
    )
    add_json(parser, "print the differences as JSON")
    parser.add_argument(
        "--events",
        metavar="PATH",
        help="recordings that both programs play, to compare their spikes and classes",
    )
    parser.add_argument("--html", metavar="FILE", help="also write a page that shows them")
