"""The reader of torch files, which needs no torch, gives the values of ``torch.load(weights_only=True)`` bit for bit.

Files are archives (zip), or *old*: in the format from before torch 1.6. A *storage* is a flat array of a file, of which
tensors are views; a file names the device on which it lay, such as ``cuda:0``.
"""

import collections
import io
import struct
import zipfile

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from locsnn_compile.data.tensors import Name, Tensor
from tests.support.torch_files import NUMBERS, Rebuilt, old_file, read, saved, storage_id

DTYPES = [
    torch.bool,
    torch.uint8,
    torch.int8,
    torch.int16,
    torch.int32,
    torch.int64,
    torch.float16,
    torch.bfloat16,
    torch.float32,
    torch.float64,
    torch.complex64,
    torch.complex128,
]
NEWER = [torch.uint16, torch.uint32, torch.uint64]
"""Types that torch itself reads back in the new format only."""


def assert_same(value_read, expected):
    """Check that a value by the project's reader is that of torch; tensors are compared by their bits."""
    if isinstance(expected, torch.Tensor):
        assert isinstance(value_read, Tensor)
        assert value_read.dtype == str(expected.dtype)
        assert value_read.shape == tuple(expected.shape)
        plain = expected.detach().resolve_conj().resolve_neg()
        # numpy has no bfloat16; our reader widens it as torch does here.
        array = (plain.float() if plain.dtype == torch.bfloat16 else plain).numpy()
        assert value_read.array().dtype == array.dtype
        assert value_read.array().shape == array.shape
        assert value_read.array().tobytes() == array.tobytes()
        assert not value_read.array().flags.writeable
    elif isinstance(expected, dict):
        assert type(value_read) is dict
        assert list(value_read) == list(expected)
        for key, value in expected.items():
            assert_same(value_read[key], value)
    elif isinstance(expected, list | tuple):
        assert type(value_read) is (list if isinstance(expected, list) else tuple)
        assert len(value_read) == len(expected)
        for item, wanted_item in zip(value_read, expected, strict=True):
            assert_same(item, wanted_item)
    elif isinstance(expected, torch.dtype | torch.device | torch.layout | torch.qscheme):
        # The project's reader has no such objects, since it needs no torch: it gives their names.
        assert value_read == Name(str(expected))
    elif isinstance(expected, float):
        assert struct.pack("d", value_read) == struct.pack("d", expected)
    else:
        assert type(value_read) is type(expected)
        assert value_read == expected


def assert_read_as_torch_does(data):
    """Check that the project's reader and torch read the same from a file."""
    expected = torch.load(io.BytesIO(data), weights_only=True, map_location="cpu")
    assert_same(read(data), expected)


@st.composite
def tensors(draw, dtypes):
    """Draw a view of a storage with any bits, or several views that share it: slices, transposes and the like."""
    dtype = draw(st.sampled_from(dtypes))
    size = draw(st.integers(0, 24))
    width = torch.empty(0, dtype=dtype).element_size()
    content = draw(st.binary(min_size=size * width, max_size=size * width))
    if dtype == torch.bool:
        content = bytes(byte & 1 for byte in content)
    # frombuffer() refuses an empty buffer.
    flat = (
        torch.frombuffer(bytearray(content), dtype=dtype) if size else torch.empty(0, dtype=dtype)
    )
    views = [flat]
    for _ in range(draw(st.integers(0, 3))):
        views.append(view(draw, draw(st.sampled_from(views))))
    return draw(st.sampled_from(views)) if draw(st.booleans()) else views


def view(draw, x):
    """Draw a view of a tensor; where a kind of view is not possible, return the tensor."""
    way = draw(
        st.sampled_from(
            ("slice", "strided", "expand", "transpose", "conj", "parameter", "column", "empty")
        )
    )
    if way == "slice" and x.ndim:
        start, step = draw(st.integers(0, 3)), draw(st.integers(1, 3))
        return x[start::step]
    if way == "strided" and x.ndim == 1 and x.numel() and x.is_contiguous() and not x.is_conj():
        rows, columns = draw(st.integers(0, 3)), draw(st.integers(1, 3))
        steps = draw(st.integers(0, 4)), draw(st.integers(0, 4))
        if (rows - 1) * steps[0] + (columns - 1) * steps[1] < x.numel():
            return x.as_strided((rows, columns), steps, x.storage_offset())
    if way == "expand" and x.ndim < 3:
        return x.expand(draw(st.integers(0, 3)), *x.shape)
    if way == "transpose" and x.ndim > 1:
        return x.transpose(0, x.ndim - 1)
    if way == "conj" and x.is_complex():
        return x.conj()
    if way == "parameter" and type(x) is torch.Tensor and (x.is_floating_point() or x.is_complex()):
        return torch.nn.Parameter(x, requires_grad=draw(st.booleans()))
    if way == "column":
        return x.unsqueeze(-1)
    return x[..., :0] if way == "empty" and x.ndim else x


def values(dtypes):
    """Return a strategy for plain values, tensors of these types, and lists, tuples and dicts of them."""
    plain = (
        st.none()
        | st.booleans()
        | st.integers(-(2**70), 2**70)
        | st.floats()
        | st.text(max_size=5)
        | st.complex_numbers(allow_nan=False)
        | st.binary(min_size=1, max_size=5)
        | st.builds(torch.Size, st.lists(st.integers(0, 9), max_size=3))
        | st.sampled_from(
            [torch.device("cpu"), torch.device("cuda", 1), torch.strided, torch.sparse_coo]
        )
        | st.sampled_from([*DTYPES, *NEWER, torch.float8_e5m2, torch.per_channel_symmetric])
        | st.sets(st.integers(-5, 2**40) | st.text(max_size=3), max_size=3)
    )
    keys = (
        st.text(max_size=4)
        | st.integers(-(2**50), 2**50)
        | st.tuples(st.integers(0, 3), st.text(max_size=2))
    )
    return st.recursive(
        plain | tensors(dtypes),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.lists(inner, max_size=4).map(tuple)
            | st.dictionaries(keys, inner, max_size=4)
            | st.dictionaries(keys, inner, max_size=4).map(collections.OrderedDict)
        ),
        max_leaves=12,
    )


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(values([*DTYPES, *NEWER]), st.sampled_from(["cpu", "cuda:0"]))
def test_archives_are_what_torch_reads(value, device):
    assert_read_as_torch_does(saved(value, device=device))


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(values(DTYPES), st.sampled_from(["cpu", "cuda:0"]))
def test_files_from_before_torch_1_6_are_what_torch_reads(value, device):
    assert_read_as_torch_does(saved(value, archive=False, device=device))


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
def test_state_dicts_of_networks_and_optimisers_are_what_torch_reads(archive):
    net = torch.nn.Sequential(
        torch.nn.Conv2d(1, 2, 3), torch.nn.BatchNorm2d(2), torch.nn.Linear(4, 2)
    )
    optimiser = torch.optim.Adam(net.parameters())
    net[0](torch.ones(1, 1, 5, 5)).sum().backward()
    optimiser.step()
    value = {
        "net": net.state_dict(),
        "optimiser": optimiser.state_dict(),
        "counts": collections.Counter("aab"),
    }
    assert_read_as_torch_does(saved(value, archive=archive))


def test_shared_storages_stay_shared():
    x = torch.arange(6.0)
    value_read = read(saved([x, x[2:], x.view(2, 3).T]))
    assert len({id(tensor.storage) for tensor in value_read}) == 1
    assert np.shares_memory(value_read[0].array(), value_read[2].array())


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
def test_an_empty_slice_may_begin_after_the_end_of_its_storage(archive):
    nothing = torch.zeros(1).as_strided((1,), (2,))[1:]
    assert nothing.storage_offset() == 2
    assert nothing.untyped_storage().nbytes() == 4
    assert_read_as_torch_does(saved(nothing, archive=archive))


def test_a_negated_view_of_complex_numbers_is_what_torch_reads():
    part = torch.tensor([1 + 2j, -0.0 + 3j, complex("nan")]).conj().imag
    assert part.is_neg()
    assert_read_as_torch_does(saved(part))


def test_storages_of_the_other_byte_order_are_what_torch_reads():
    numbers = {str(d): torch.arange(7).to(d) for d in DTYPES} | {"x": torch.tensor([1 + 2j])}
    data = saved(numbers)
    swapped = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(swapped, "w") as other:
        for entry in archive.infolist():
            is_order = entry.filename.endswith("/byteorder")
            other.writestr(entry.filename, b"big" if is_order else archive.read(entry))
    assert_read_as_torch_does(swapped.getvalue())


def test_a_storage_may_be_a_part_of_another_as_before_torch_1_0():
    rebuilt = torch._utils._rebuild_tensor
    # Storage "8" is the three numbers from number 1 on of storage "7". Arguments of the rebuilding function: a storage,
    # the offset of the tensor in it, its shape, and its strides.
    part_of_storage = storage_id(("8", 1, 3))
    parts = [
        Rebuilt(rebuilt, part_of_storage, 1, (2,), (1,)),
        Rebuilt(rebuilt, storage_id(), 0, (5,), (1,)),
    ]
    data = old_file(parts, [("7", NUMBERS)])
    assert_read_as_torch_does(data)
    assert [tensor.array().tolist() for tensor in read(data)] == [[2, 3], [0, 1, 2, 3, 4]]


def test_a_file_written_by_python_2_is_what_torch_reads():
    """Its texts are bytes, its dicts are lists of pairs, and its storages belong to a class of CUDA."""
    # Two pickles, a magic number and the protocol, and the beginning of the third: all before the dict that describes
    # the machine, whose pickle begins with these bytes. The dict is empty in this file.
    head = old_file(0).partition(b"}q\x00")[0]
    # A pickled list of the one storage, "7", and the number of its elements.
    storages = b"\x80\x02](U\x017e." + struct.pack("<q", 5)
    # A pickled OrderedDict of one pair: fc1, and a tensor of shape (5,) and stride (1,) on "7".
    value = (
        b"\x80\x02ccollections\nOrderedDict\n](](U\x03fc1ctorch._utils\n_rebuild_tensor\n"
        b"((U\x07storagectorch.cuda\nFloatStorage\nU\x017U\x06cuda:0K\x05NtQK\x00K\x05\x85K\x01\x85tRee\x85R."
    )
    data = head + b"}." + value + storages + NUMBERS.tobytes()
    assert_read_as_torch_does(data)
    assert read(data)["fc1"].array().tolist() == NUMBERS.tolist()


OTHER = [
    pytest.param(
        lambda: torch.eye(3).to_sparse(),
        ("torch.float32", (3, 3), "torch.sparse_coo", "cpu"),
        id="sparse",
    ),
    pytest.param(
        lambda: torch.eye(3).to_sparse_csr(),
        ("torch.float32", (3, 3), "torch.sparse_csr", "cpu"),
        id="rows",
    ),
    pytest.param(
        lambda: torch.zeros(2, device="meta"),
        ("torch.float32", (2,), "torch.strided", "meta"),
        id="meta",
    ),
    pytest.param(
        lambda: torch.ones(2).to(torch.float8_e5m2),
        ("torch.float8_e5m2", (2,), "torch.strided", "cpu"),
        id="eight bits",
    ),
    pytest.param(
        lambda: torch.ones(2).to(torch.complex32),
        ("torch.complex32", (2,), "torch.strided", "cpu"),
        id="half complex",
    ),
    pytest.param(
        lambda: torch._empty_affine_quantized((2,), scale=0.5, zero_point=0, dtype=torch.qint32),
        ("torch.qint32", (2,), "torch.strided", "cpu"),
        id="quantised",
    ),
]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("make", "expected"), OTHER)
def test_tensors_that_numpy_cannot_hold_keep_their_type_and_shape(make, expected):
    value_read, plain_tensor = read(saved([make(), torch.ones(2)]))
    assert (value_read.dtype, value_read.shape, value_read.layout, value_read.device) == expected
    assert value_read.array() is None
    assert plain_tensor.array().tolist() == [1, 1]


def test_storages_that_are_values_are_read_as_tensors():
    value_read = read(saved([torch.ones(2).untyped_storage(), torch.arange(3)._typed_storage()]))
    assert [(tensor.dtype, tensor.shape) for tensor in value_read] == [
        ("torch.uint8", (8,)),
        ("torch.int64", (3,)),
    ]
    assert value_read[1].array().tolist() == [0, 1, 2]
