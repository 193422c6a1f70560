"""Write ``camera-evt2.raw``, ``camera-evt3.raw``, ``camera.dat`` and ``scene-evt3.raw`` with a library.

``pip install faery expelliarmus``, then run this. It writes with faery, and reads back what the two
libraries agree on: expelliarmus does not follow the wraps of time in EVT3.
"""

from pathlib import Path

import numpy as np

SIZE = (34, 20)
"""Columns and rows."""
ROW_OF_VECTORS = [(5_000, x, 7, 1) for x in range(2, 32) if x % 5]
"""Neighbours that spike at once, which EVT3 writes as bits of vectors."""
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


def scene() -> list[tuple[int, ...]]:
    """Return events at random places of the same sensor, in the order of their times."""
    generator = np.random.default_rng(5)
    limits = (SCENE_MICROSECONDS, (0, SIZE[0]), (0, SIZE[1]), (0, 2))
    columns = [generator.integers(*limit, SCENE_EVENTS) for limit in limits]
    return sorted({tuple(map(int, event)) for event in zip(*columns, strict=True)})


FILES = {"camera-evt2.raw": "evt2", "camera-evt3.raw": "evt3", "camera.dat": "dat2"}

if __name__ == "__main__":
    import expelliarmus
    import faery

    folder = Path(__file__).parents[1] / "data"
    events = np.array(list(EVENTS), dtype=faery.EVENTS_DTYPE)
    for name, version in FILES.items():
        path = folder / name
        stream = faery.events_stream_from_array(events, dimensions=SIZE)
        stream.to_file(path, version=version, zero_t0=False)
        kind = version.removesuffix("2") if version == "dat2" else version
        back = expelliarmus.Wizard(encoding=kind).read(path)
        same = [tuple(map(int, event)) for event in back] == list(EVENTS)
        print(name, "read back by expelliarmus:", "equal" if same else "times wrap")
    events = np.array(scene(), dtype=faery.EVENTS_DTYPE)
    stream = faery.events_stream_from_array(events, dimensions=SIZE)
    stream.to_file(folder / "scene-evt3.raw", version="evt3", zero_t0=False)
