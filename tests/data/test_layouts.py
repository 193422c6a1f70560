"""Layouts of sensors, by options and by files, and the walks, graphs and frames over them.

A layout has taxels (touch-sensitive points, or pixels) at positions, with one or two polarities. A walk is the order in
which location neurons visit the taxels, and a taxel graph joins neighbours.
"""

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.axes import parse_axes, to_step_major
from locsnn_compile.data.orders import BY_PLACE, location_order, order_text
from locsnn_compile.data.sensor import (
    SensorLayout,
    asked_layout,
    frame_cells,
    frame_size,
    neutouch,
    parse_layout,
    read_layout,
)
from locsnn_compile.data.statistics import channel_place
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.taxel_graph import taxel_graph
from locsnn_compile.errors import InputError


def grid_layout(text: str, polarities: int) -> SensorLayout:
    """Return the layout of a grid, such as ``34x34``."""
    columns, rows = map(int, text.split("x"))
    return SensorLayout(f"grid {text}", columns * rows, polarities, columns=columns)


GRID = grid_layout("4x3", 2)
NOWHERE = SensorLayout("8 channels", taxels=8)
GLOVE = SensorLayout(
    "glove",
    taxels=3,
    polarities=1,
    surfaces=2,
    positions=((0.0, 0.0), (2.0, 0.0), (0.0, 1.0)),
    names=("thumb", "index", "palm"),
)


def refused(call: object, *args: object, **options: object) -> str:
    """Return the message with which a call is refused."""
    with pytest.raises(InputError) as caught:
        call(*args, **options)  # type: ignore[operator]
    return str(caught.value)


@pytest.mark.parametrize(
    ("options", "channels", "name"),
    [
        pytest.param(("16x16", 2, None, None), 512, "grid 16x16", id="grid"),
        pytest.param(("16x16", 1, None, None), 256, "grid 16x16", id="one polarity"),
        pytest.param(("16x8", None, None, None), 256, "grid 16x8", id="a grid has two polarities"),
        pytest.param((None, None, 40, None), 40, "40 channels", id="channels"),
        pytest.param((None, 2, 40, None), 40, "40 channels", id="channels of two polarities"),
    ],
)
def test_options_name_a_sensor(options: tuple, channels: int, name: str) -> None:
    layout = asked_layout(*options)
    assert layout is not None
    assert layout.channels == channels
    assert layout.name == name


def test_no_option_names_no_sensor() -> None:
    assert asked_layout(grid=None, polarities=None, channels=None, layout=None) is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            ("16x16", None, 40, None),
            "sensor: its layout is not clear (grid and channels). "
            "Give one of --grid, --channels and --layout.",
            id="two",
        ),
        pytest.param(
            (None, 2, None, None),
            "sensor: its layout is not clear (polarities alone). "
            "Give one of --grid, --channels and --layout.",
            id="polarities of nothing",
        ),
        pytest.param(
            (None, 2, 41, None),
            "channels: 2 polarities need an even number (41). Correct it.",
            id="half a taxel",
        ),
        pytest.param(
            ("16", None, None, None),
            "grid: it is not columns x rows (got '16'). Give 16x16.",
            id="one side",
        ),
        pytest.param(
            ("128x129", 2, None, None),
            "sensor 'grid 128x129': its channels are out of range (got 33024 against 1..32768). "
            "Correct the layout of the sensor.",
            id="too large",
        ),
    ],
)
def test_options_that_do_not_name_one_sensor_are_refused(options: tuple, message: str) -> None:
    assert refused(asked_layout, *options) == message


def test_a_file_gives_positions_and_names(tmp_path: Path) -> None:
    path = tmp_path / "glove.yaml"
    path.write_text(
        "surfaces: 2\npositions: [[0, 0], [2, 0], [0, 1]]\nnames: [thumb, index, palm]\n"
    )
    assert read_layout(path) == GLOVE
    assert asked_layout(grid=None, polarities=2, channels=None, layout=str(path)).channels == 12  # type: ignore[union-attr]


def test_a_layout_is_equal_after_a_round_trip_through_its_document() -> None:
    for layout in (GRID, NOWHERE, GLOVE, neutouch(2)):
        assert parse_layout(layout.document(), "layout") == layout


@pytest.mark.parametrize(
    ("document", "message"),
    [
        pytest.param(
            {"name": "x", "taxels": 3, "taxel": 3},
            "layout: unknown key 'taxel'. Did you mean 'taxels'?",
            id="key",
        ),
        pytest.param({"name": "x"}, "layout: the key 'taxels' is missing. ", id="no size"),
        pytest.param(
            {"name": 3, "taxels": 3},
            "layout: name: it must be text (got 3). Put it in quotes.",
            id="no name",
        ),
        pytest.param(
            {"name": "x", "taxels": True},
            "layout: taxels: it must be a whole number (got True). ",
            id="no number",
        ),
        pytest.param(
            {"name": "x", "positions": [[0, 1], [float("nan"), 0]]},
            "layout: positions: it must be a number from -1000000000 to 1000000000 (got nan). ",
            id="no place",
        ),
        pytest.param(
            {"name": "x", "names": [1, 2]},
            "layout: names: it must be text (got 1). Put it in quotes.",
            id="no names",
        ),
        pytest.param(
            {"name": "x", "positions": [[0, 1], [0, 1]]},
            "sensor 'x': its positions do not fit its taxels (1 different ones against 2 taxels). ",
            id="same place",
        ),
        pytest.param(
            {"name": "x", "positions": [[0, 1], [0, 2]], "names": ["a"]},
            "sensor 'x': its names do not fit its taxels (1 different ones against 2 taxels). ",
            id="a name is missing",
        ),
        pytest.param(
            {"name": "x", "taxels": 7, "columns": 2},
            "sensor 'x': its last row is not full (7 taxels). ",
            id="ragged",
        ),
        pytest.param(
            {"name": "x", "columns": 2, "positions": [[0, 1], [0, 2]]},
            "sensor 'x': its positions follow from its columns, but others were given (2 columns). ",
            id="a grid with positions",
        ),
        pytest.param(
            {"name": "x", "taxels": 7, "polarities": 3},
            "sensor 'x': its polarities are out of range (got 3 against 1..2). ",
            id="polarities",
        ),
    ],
)
def test_files_that_are_no_layout_are_refused(document: dict, message: str) -> None:
    """Messages that end with a space go on with the usual way out."""
    way_out = "Correct the layout of the sensor." if message.endswith(" ") else ""
    assert refused(parse_layout, document, "layout") == message + way_out


EXPECTED = {
    "loop": [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    "reverse": [12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1],
    "raster": [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    "snake": [1, 2, 3, 4, 8, 7, 6, 5, 9, 10, 11, 12],
    "spiral": [7, 6, 1, 2, 3, 4, 8, 12, 11, 10, 9, 5],
    "tour": [1, 2, 3, 4, 8, 7, 6, 5, 9, 10, 11, 12],
}


@pytest.mark.parametrize("name", EXPECTED)
def test_walks_over_a_grid(name: str) -> None:
    assert location_order(name, GRID) == (name, tuple(EXPECTED[name]))


@pytest.mark.parametrize(
    ("name", "bands"),
    [
        pytest.param("loop", [1, 2, 3, 4, 5], id="up"),
        pytest.param("reverse", [5, 4, 3, 2, 1], id="down"),
        pytest.param("spiral", [3, 4, 2, 5, 1], id="from the middle"),
    ],
)
def test_walks_over_the_bands_of_a_cochlea(name: str, bands: list[int]) -> None:
    assert location_order(name, grid_layout("5x1", 2)) == (name, tuple(bands))


def test_a_reversed_walk_needs_no_places() -> None:
    assert location_order("reverse", NOWHERE) == ("reverse", (8, 7, 6, 5, 4, 3, 2, 1))


@pytest.mark.parametrize("name", ["hilbert", "snake", "tour"])
def test_a_walk_over_a_square_goes_from_neighbour_to_neighbour(name: str) -> None:
    layout = grid_layout("16x16", 1)
    places = np.array(layout.places)[np.array(location_order(name, layout)[1]) - 1]
    assert (np.abs(np.diff(places, axis=0)).sum(axis=1) == 1).all()


@pytest.mark.parametrize("layout", [GRID, GLOVE, neutouch()], ids=lambda layout: layout.name)
@pytest.mark.parametrize("name", BY_PLACE)
def test_a_walk_visits_every_taxel_once(name: str, layout: SensorLayout) -> None:
    assert sorted(location_order(name, layout)[1]) == list(range(1, layout.taxels + 1))


def test_a_file_of_numbers_is_an_order(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    path.write_text("3 1\n2\n")
    assert location_order(order_text(str(path)), GLOVE) == ("custom", (3, 1, 2))
    assert order_text("spiral") == "spiral"
    missing = refused(order_text, str(tmp_path / "none.txt"))
    assert (
        missing
        == "location order 'none.txt': it cannot be read (No such file or directory). Check the path."
    )


@pytest.mark.parametrize(
    ("name", "layout", "message"),
    [
        pytest.param(
            "arch",
            GRID,
            "location order 'arch': it is a walk over the 39 taxels of a NeuTouch fingertip (sensor 'grid 4x3'). "
            "Use one of: loop, reverse, raster, snake, spiral, hilbert, tour.",
            id="arch of a grid",
        ),
        pytest.param(
            "spiral",
            NOWHERE,
            "location order 'spiral': it needs to know where the taxels lie, and sensor '8 channels' does not give their positions. "
            "Give --grid WxH, or --layout FILE with positions.",
            id="no places",
        ),
        pytest.param(
            "1,2,2",
            GLOVE,
            "location order: taxel 2 is repeated at entry 3. "
            "Give every taxel from 1 to 3 exactly once.",
            id="repeated",
        ),
    ],
)
def test_walks_that_a_layout_does_not_have_are_refused(
    name: str, layout: SensorLayout, message: str
) -> None:
    assert refused(location_order, name, layout) == message


def test_graphs_join_neighbours_of_a_grid() -> None:
    pairs = taxel_graph("tree", grid_layout("3x2", 1), neighbours=3, nearer_mm=1.1)
    assert pairs == ((1, 2), (1, 4), (2, 3), (2, 5), (3, 6), (4, 5), (5, 6))
    tree = taxel_graph("tree", grid_layout("5x5", 1), neighbours=3, nearer_mm=0.0)
    assert len(tree) == 24
    near = taxel_graph("nearest", GLOVE, neighbours=9, nearer_mm=0.0)
    assert near == ((1, 2), (1, 3), (2, 3))


@pytest.mark.parametrize(
    ("kind", "layout", "message"),
    [
        pytest.param(
            "manual",
            GRID,
            "taxel graph 'manual': its edges were drawn by hand for a NeuTouch fingertip (sensor 'grid 4x3'). "
            "Use --graph nearest or tree.",
            id="manual",
        ),
        pytest.param(
            "tree",
            NOWHERE,
            "taxel graph 'tree': it needs to know where the taxels lie, and sensor '8 channels' does not give their positions. "
            "Give --grid WxH, or --layout FILE with positions.",
            id="no places",
        ),
    ],
)
def test_graphs_that_a_layout_does_not_have_are_refused(
    kind: str, layout: SensorLayout, message: str
) -> None:
    assert refused(taxel_graph, kind, layout, neighbours=3, nearer_mm=3.0) == message


def test_frames_are_grids() -> None:
    layout = grid_layout("6x5", 1)
    assert frame_size(layout) == (5, 6)
    assert frame_cells(layout).tolist() == list(range(30))
    assert refused(frame_size, GRID) == (
        "network 'cnn-3d': its frames need a grid of at least 5 x 5 taxels (sensor 'grid 4x3'). "
        "Give --grid WxH of the sensor, or use another network."
    )


@pytest.mark.parametrize(
    ("channel", "layout", "place"),
    [
        pytest.param(11, GRID, "row 2, column 2 falling", id="grid"),
        pytest.param(4, GLOVE, "surface 2, index", id="names"),
        pytest.param(7, NOWHERE, "taxel 8", id="nowhere"),
        pytest.param(79, neutouch(2), "fingertip 2, taxel 1 falling", id="fingertip"),
    ],
)
def test_a_channel_is_called_by_its_place(channel: int, layout: SensorLayout, place: str) -> None:
    assert channel_place(channel, layout) == place


@pytest.mark.parametrize(
    "layout", [GRID, NOWHERE, GLOVE, SensorLayout("one", taxels=1)], ids=lambda layout: layout.name
)
def test_synthetic_touches_of_any_sensor(layout: SensorLayout) -> None:
    touches = synthetic_touches(4, steps=60, classes=2, sensor=layout)
    assert touches.spikes.shape == (4, 60, layout.channels)
    assert 0 < touches.spikes.mean() < 0.5


def test_synthetic_touches_of_a_fingertip_are_those_of_its_layout() -> None:
    by_fingertips = synthetic_touches(2, steps=50, fingertips=2)
    by_layout = synthetic_touches(2, steps=50, sensor=neutouch(2))
    assert np.array_equal(by_fingertips.spikes, by_layout.spikes)


@pytest.mark.parametrize(
    ("order", "shape"),
    [
        pytest.param("samples,steps,channels", (2, 5, 24), id="Python arrays"),
        pytest.param("samples, steps, polarities, rows, columns", (2, 5, 2, 3, 4), id="frames"),
        pytest.param("steps taxels polarities", (5, 12, 2), id="one recording"),
        pytest.param("columns,rows,steps,samples", (4, 3, 5, 2), id="no polarities"),
    ],
)
def test_axes_are_taken_in_the_given_order(order: str, shape: tuple[int, ...]) -> None:
    """Every value of the array is different, so that one value at the end of an axis shows where the axis went."""
    array = np.arange(np.prod(shape)).reshape(shape)
    names = parse_axes(order, "axes")
    step_major = to_step_major(array, "array", order=names)
    size = dict(zip(names, shape, strict=True))
    samples = size.get("samples", 1)
    steps = 5
    assert step_major.shape == (samples, steps, array.size // steps // samples)
    # The last row, taxel or channel, at index 0 of all other axes, and its channel.
    index = {
        name: size[name] - 1 if name in ("rows", "taxels", "channels") else 0 for name in names
    }
    cell = index.get("rows", 0) * size.get("columns", 1) + index.get("taxels", 0)
    channel = cell * size.get("polarities", 1) + index.get("channels", 0)
    assert step_major[0, 0, channel] == array[tuple(index.values())]


@pytest.mark.parametrize(
    "order",
    [
        "samples,channels",
        "steps,rows",
        "steps,channels,taxels",
        "steps,steps,channels",
        "time,channels",
        "",
    ],
)
def test_texts_that_are_no_order_of_axes_are_refused(order: str) -> None:
    assert refused(parse_axes, order, "axes") == (
        f"axes: it is not an order of axes (got {order!r}). Name steps and channels, or taxels, "
        "or rows and columns, with polarities or without, and samples."
    )


def test_an_array_with_another_number_of_axes_than_named_is_refused() -> None:
    assert refused(
        to_step_major, np.zeros((2, 3)), "array", order=("samples", "steps", "channels")
    ) == (
        "array: its shape is not one of recordings (2 axes against 3). Give (samples, steps, channels)."
    )
