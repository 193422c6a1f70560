"""AEDAT4, the format of iniVation's cameras, by the package ``aedat``: the first stream of events of a file."""

import importlib.util
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hw_model.io.npy import load_npy
from locsnn_compile.data.event_formats import parse_structured
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.errors import InputError

_CHILD = Path(__file__).with_name("aedat4_child.py")
_SECONDS = 60


def parse_aedat4(data: bytes, where: str) -> EventStream:
    """Return the events of the bytes of an ``.aedat4`` file, of two polarities, from its first event on.

    A process of its own reads a copy of them, in 10 seconds of the processor and 2 GiB, because the package does not
    survive all damage. Raises ``InputError`` for a file that it cannot read, one without events, and where the package
    is missing.
    """
    if importlib.util.find_spec("aedat") is None:
        fix = "Install it with: pip install 'locsnn-compile[aedat]'."
        raise InputError(where, "it needs the package aedat, which is not installed", fix=fix)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.aedat4"
        path.write_bytes(data)
        command = [sys.executable, "-P", str(_CHILD), str(path), str(MAX_EVENTS)]
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # each takes memory, of which little is allowed
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=_SECONDS, check=True)
        except subprocess.SubprocessError:
            fix = "Give a whole AEDAT4 file with events."
            raise InputError(where, "it is damaged, truncated or has no events", fix=fix) from None
    size, array = done.stdout.split(b"\n", maxsplit=1)
    width, height = map(int, size.split())
    stream = parse_structured(load_npy(array, where), where)
    start = float(stream.times.min()) if len(stream.times) else 0.0
    return replace(stream, start=start, channels=2 * width * height, polarities=2, columns=width)
