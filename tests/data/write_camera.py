"""Write the AEDAT4 files of the tests: ``camera.aedat4``, and ``cameras.aedat4`` with the events of six cameras.

To write them again, ``pip install dv-processing``, the library of the cameras, and run this module.
"""

from pathlib import Path

import dv_processing as dv

EVENTS = ((0, 5, 7, True), (20_000, 33, 33, False), (59_999, 0, 0, True))
"""Microseconds, x, y and polarity, as in ``test_event_sets.py``."""
START = 1_700_000_000_000_000
"""Microseconds since 1970, as cameras record the time of the computer's clock."""

if __name__ == "__main__":
    store = dv.EventStore()
    for t, x, y, p in EVENTS:
        store.push_back(START + t, x, y, p)
    path = str(Path(__file__).with_name("camera.aedat4"))
    writer = dv.io.MonoCameraWriter(
        path, dv.io.MonoCameraWriter.EventOnlyConfig("camera", (34, 34))
    )
    writer.writeEvents(store)
    config = dv.io.MonoCameraWriter.Config("cameras")
    for number in range(6):
        config.addEventStream((34 + number, 34), f"camera{number}")
    writer = dv.io.MonoCameraWriter(str(Path(__file__).with_name("cameras.aedat4")), config)
    for number in range(6):
        writer.writeEvents(store, f"camera{number}")
