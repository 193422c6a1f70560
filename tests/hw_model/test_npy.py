"""Untrusted ``.npy`` files: which types of values are read, how many, and the whole message for all others."""

from __future__ import annotations

import io

import numpy as np
import pytest

import hw_model as hw
from hw_model.io.npy import MAX_VALUES, holds_numbers, load_npy

PAIRS = np.dtype([("t", "<i8"), ("x", "<i8")])
FIX = "Write it again with numpy.save."


def claiming(shape: tuple[int, ...], dtype: np.dtype) -> bytes:
    """Return a file whose header claims values that it does not have."""
    content = io.BytesIO()
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(content, header)
    return content.getvalue()


def written(array: np.ndarray) -> bytes:
    """Return the file that numpy writes of an array."""
    content = io.BytesIO()
    np.save(content, array)
    return content.getvalue()


@pytest.mark.parametrize(
    "array",
    [
        np.array([[1, 2], [3, 4]], dtype=np.uint8),
        np.asfortranarray([[1.5, 2.0], [3.0, 4.0]]),
        np.array([True, False]),
        np.array([(1, 2), (3, 4)], dtype=PAIRS),
        np.zeros((0, 3)),
    ],
    ids=["bytes", "columns first", "booleans", "records", "nothing"],
)
def test_an_array_is_read_as_it_was_written(array):
    loaded = load_npy(written(array), "a.npy")
    assert (loaded.dtype, loaded.tolist()) == (array.dtype, array.tolist())
    assert not loaded.flags.writeable


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (claiming((MAX_VALUES + 1,), np.dtype("<i8")), f"its declared shape is too large ({MAX_VALUES + 1} against {MAX_VALUES} values). Give a smaller array."),
        (claiming((MAX_VALUES // 2 + 1,), PAIRS), f"its declared shape is too large ({MAX_VALUES // 2 + 1} against {MAX_VALUES} values). Give a smaller array."),
        (claiming((MAX_VALUES // 2,), PAIRS), f"it is truncated (0 of {MAX_VALUES * 8} bytes). {FIX}"),
        (claiming((2,), np.dtype("<U3")), f"its values are not numbers (dtype <U3). {FIX}"),
        (claiming((2,), np.dtype([("t", "<i8"), ("x", "O")])), f"its values are not numbers (dtype [('t', '<i8'), ('x', 'O')]). {FIX}"),
        (b"\x93NUMPY", f"it is damaged or not a numpy file. {FIX}"),
    ],
    ids=["values", "values of records", "no more than that", "texts", "records of objects", "no header"],
)  # fmt: skip
def test_damaged_large_and_non_numeric_files_are_refused(content, message):
    with pytest.raises(hw.InputError) as error:
        load_npy(content, "a.npy")
    assert str(error.value) == f"a.npy: {message}"


@pytest.mark.parametrize(
    ("dtype", "is_numbers"),
    [
        (np.dtype("?"), True),
        (np.dtype("<f4"), True),
        (PAIRS, True),
        (np.dtype("<U3"), False),
        (np.dtype("O"), False),
        (np.dtype([("t", "<i8"), ("x", "O")]), False),
    ],
    ids=["booleans", "floats", "records", "texts", "objects", "records of objects"],
)
def test_a_header_says_whether_a_file_holds_numbers(dtype, is_numbers):
    assert holds_numbers(claiming((2,), dtype), "a.npy") is is_numbers
