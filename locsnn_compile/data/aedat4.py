"""Read AEDAT4, the format of iniVation's cameras, with the package ``aedat``: the first stream of events in a file."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hw_model.io.extras import needed
from hw_model.io.npy import load_npy
from locsnn_compile.data.event_formats import parse_structured
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.errors import InputError

_CHILD = Path(__file__).with_name("aedat4_child.py")
_SECONDS = 60


def parse_aedat4(data: bytes, where: str) -> EventStream:
    """Return the events in the bytes of an ``.aedat4`` file, with two polarities; time starts at the first event.

    The package does not survive all damage, so a separate process reads a copy, within 10 seconds of processor time and
    2 GiB. Raises ``InputError`` for a file that it cannot read, for one without events, and if the package is missing.
    """
    needed("aedat", "aedat", where)
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
