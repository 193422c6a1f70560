"""Write the camera files ``camera-evt2.raw``, ``camera-evt3.raw``, ``camera.dat`` and ``scene-evt3.raw`` of the tests.

To write them again, ``pip install faery expelliarmus`` and run this module. It writes with faery, reads each file back
with expelliarmus, and prints whether both agree: expelliarmus does not follow the wraps of time in EVT3.
"""

from pathlib import Path

import numpy as np

SIZE = (34, 20)
"""Columns and rows."""
ROW_OF_VECTORS = [(5_000, x, 7, 1) for x in range(2, 32) if x % 5]
"""Neighbouring pixels of a row that spike at the same time, which EVT3 writes as bits of vectors."""
EVENTS = (
    (3_000, 33, 19, 0),
    (4_095, 0, 0, 1),
    (4_096, 1, 0, 1),
    *ROW_OF_VECTORS,
    (5_000, 32, 8, 0),
    (16_777_215, 4, 5, 0),
    (20_000_000, 5, 4, 1),
    (40_000_000, 6, 3, 0),
)
"""Microseconds, x, y and polarity. The time of EVT3 wraps after 16,777,216 microseconds."""
SCENE_EVENTS = 900
SCENE_MICROSECONDS = (7_000, 56_900)
"""The first time of the scene and the end of its times; from its first event on it has 50 steps of 1 ms."""


def scene() -> list[tuple[int, ...]]:
    """Return different events (time, x, y, polarity) at random places of the same sensor, in the order of their times."""
    generator = np.random.default_rng(5)
    times = generator.integers(*SCENE_MICROSECONDS, SCENE_EVENTS)
    x = generator.integers(0, SIZE[0], SCENE_EVENTS)
    y = generator.integers(0, SIZE[1], SCENE_EVENTS)
    polarity = generator.integers(0, 2, SCENE_EVENTS)
    events = zip(times.tolist(), x.tolist(), y.tolist(), polarity.tolist(), strict=True)
    return sorted(set(events))


FILES = {"camera-evt2.raw": "evt2", "camera-evt3.raw": "evt3", "camera.dat": "dat2"}
"""The formats of the files of :data:`EVENTS`, by their names in faery."""

if __name__ == "__main__":
    import expelliarmus
    import faery

    folder = Path(__file__).parents[1] / "data"
    events = np.array(list(EVENTS), dtype=faery.EVENTS_DTYPE)
    for name, version in FILES.items():
        path = folder / name
        stream = faery.events_stream_from_array(events, dimensions=SIZE)
        stream.to_file(path, version=version, zero_t0=False)
        encoding = "dat" if version == "dat2" else version
        events_read = expelliarmus.Wizard(encoding=encoding).read(path)
        same = [tuple(map(int, event)) for event in events_read] == list(EVENTS)
        print(name, "read back by expelliarmus:", "equal" if same else "times wrap")
    events = np.array(scene(), dtype=faery.EVENTS_DTYPE)
    stream = faery.events_stream_from_array(events, dimensions=SIZE)
    stream.to_file(folder / "scene-evt3.raw", version="evt3", zero_t0=False)
