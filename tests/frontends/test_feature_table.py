"""Every cell of the table of model formats and features is true, and the manual's file lists them all.

A feature that works, or loses something, is compiled, and the chip must follow the float reference. A refused feature
must be refused with the message of its cell.
"""

from pathlib import Path

import numpy as np
import pytest
from feature_table import CELLS, LEAST_AGREEMENT, table

import locsnn_compile as lc

LIST = Path(__file__).parents[2] / "docs/reference/formats/features.csv"
STEPS = 90
"""Length of recordings for networks that take any length: long enough for small networks to spike."""


def loaded(cell, folder):
    """Return the network of a cell's model file."""
    path, *config = cell.write_model(folder)
    return lc.load(path, *config, **cell.options)


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: f"{cell.format}, {cell.feature}")
def test_a_cell_says_what_happens(cell, tmp_path):
    if cell.message:
        with pytest.raises(lc.InputError) as caught:
            loaded(cell, tmp_path)
        # slayerPytorch's errors name other files, so the messages of these cells are whole.
        suffix = "nir" if cell.format == "NIR" else "net"
        assert str(caught.value).removeprefix(f"model 'model.{suffix}'") == cell.message
        return
    network = loaded(cell, tmp_path)
    assert cell.shows_loss(network)
    steps = STEPS if network.any_length else network.steps
    shape = (2, steps, network.channels)
    events = (np.random.default_rng(3).random(shape) < 0.2).astype(np.uint8)
    match = lc.compile(network, events=events, diagnosis=False).match
    assert match.spikes.reference_spikes > 0
    assert match.spikes.agreement >= LEAST_AGREEMENT[cell.format]


def test_the_list_is_that_of_the_cells():
    """To write it: ``LIST.write_text(table(), encoding="utf-8")``."""
    assert table() == LIST.read_text("utf-8")
