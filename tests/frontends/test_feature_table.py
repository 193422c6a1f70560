"""Every cell of the table of formats and features, and the file that lists them."""

from pathlib import Path

import numpy as np
import pytest
from feature_table import CELLS, LEAST_AGREEMENT, table

import locsnn_compile as lc

LIST = Path(__file__).parents[2] / "docs/reference/formats/features.csv"


def loaded(cell, folder):
    path, *config = cell.made(folder)
    return lc.load(path, *config, **cell.options)


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: f"{cell.format}, {cell.feature}")
def test_a_cell_says_what_happens(cell, tmp_path):
    if cell.message:
        with pytest.raises(lc.InputError) as caught:
            loaded(cell, tmp_path)
        assert (
            str(caught.value).removeprefix(
                f"model 'model.{'nir' if cell.format == 'NIR' else 'net'}'"
            )
            == cell.message
        )
        return
    network = loaded(cell, tmp_path)
    assert cell.shows(network)
    steps = network.steps if not network.any_length else 90
    given = (np.random.default_rng(3).random((2, steps, network.channels)) < 0.2).astype(np.uint8)
    match = lc.compile(network, events=given, diagnosis=False).match
    assert match.spikes.reference_spikes > 0
    assert match.spikes.agreement >= LEAST_AGREEMENT[cell.format]


def test_the_list_is_that_of_the_cells():
    """To write it: ``LIST.write_text(table(), encoding="utf-8")``."""
    assert table() == LIST.read_text("utf-8")
