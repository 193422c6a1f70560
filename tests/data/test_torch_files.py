"""Torch's files without torch: the values of ``torch.load(weights_only=True)`` bit for bit, and nothing that hurts."""

import collections
import io
import pickle
import struct
import tarfile
import time
import zipfile
from unittest import mock

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from locsnn_compile.data.plain_pickle import MAX_VALUES
from locsnn_compile.data.tensors import Name, Tensor
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError

DTYPES = [
    *(torch.bool, torch.uint8, torch.int8, torch.int16, torch.int32, torch.int64, torch.float16, torch.bfloat16),
    *(torch.float32, torch.float64, torch.complex64, torch.complex128),
]
NEWER = [torch.uint16, torch.uint32, torch.uint64]
"""Of these, torch reads what it wrote in the new format only."""


def saved(value, *, archive=True, place="cpu"):
    """Return the file of a value as torch writes it, from a GPU where ``place`` says that."""
    stream = io.BytesIO()
    with mock.patch("torch.serialization.location_tag", return_value=place):
        torch.save(value, stream, _use_new_zipfile_serialization=archive)
    return stream.getvalue()


def read(data):
    return load_plain(data, "file 'a.pt'", fix="Write it again.")


def refusal(data):
    with pytest.raises(InputError) as caught:
        read(data)
    return str(caught.value)


def same(found, wanted):
    """Compare a value with torch's, tensors by their bits."""
    if isinstance(wanted, torch.Tensor):
        assert isinstance(found, Tensor)
        assert (found.dtype, found.shape) == (str(wanted.dtype), tuple(wanted.shape))
        plain = wanted.detach().resolve_conj().resolve_neg()
        array = (plain.float() if plain.dtype == torch.bfloat16 else plain).numpy()
        assert found.array().dtype == array.dtype
        assert found.array().shape == array.shape
        assert found.array().tobytes() == array.tobytes()
        assert not found.array().flags.writeable
    elif isinstance(wanted, dict):
        assert type(found) is dict
        assert list(found) == list(wanted)
        for key, value in wanted.items():
            same(found[key], value)
    elif isinstance(wanted, list | tuple):
        assert type(found) is (list if isinstance(wanted, list) else tuple)
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            same(one, other)
    elif isinstance(wanted, torch.dtype | torch.device | torch.layout | torch.qscheme):
        assert found == Name(str(wanted))
    elif isinstance(wanted, float):
        assert struct.pack("d", found) == struct.pack("d", wanted)
    else:
        assert type(found) is type(wanted)
        assert found == wanted


def as_torch_does(data):
    same(read(data), torch.load(io.BytesIO(data), weights_only=True, map_location="cpu"))


@st.composite
def tensors(draw, dtypes):
    """A view of one of a few storages of any bits, as slices, transposes, strides and axes of one make them."""
    dtype = draw(st.sampled_from(dtypes))
    size = draw(st.integers(0, 24))
    width = torch.empty(0, dtype=dtype).element_size()
    content = draw(st.binary(min_size=size * width, max_size=size * width))
    if dtype == torch.bool:
        content = bytes(byte & 1 for byte in content)
    whole = torch.frombuffer(bytearray(content), dtype=dtype) if size else torch.empty(0, dtype=dtype)
    views = [whole]
    for _ in range(draw(st.integers(0, 3))):
        views.append(view(draw, draw(st.sampled_from(views))))
    return draw(st.sampled_from(views)) if draw(st.booleans()) else views


def view(draw, x):
    way = draw(st.sampled_from(("slice", "strided", "expand", "transpose", "conj", "parameter", "column", "empty")))
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
    plain = (
        st.none()
        | st.booleans()
        | st.integers(-(2**70), 2**70)
        | st.floats()
        | st.text(max_size=5)
        | st.complex_numbers(allow_nan=False)
        | st.binary(min_size=1, max_size=5)
        | st.builds(torch.Size, st.lists(st.integers(0, 9), max_size=3))
        | st.sampled_from([torch.device("cpu"), torch.device("cuda", 1), torch.strided, torch.sparse_coo])
        | st.sampled_from([*DTYPES, *NEWER, torch.float8_e5m2, torch.per_channel_symmetric])
        | st.sets(st.integers(-5, 2**40) | st.text(max_size=3), max_size=3)
    )
    keys = st.text(max_size=4) | st.integers(-(2**50), 2**50) | st.tuples(st.integers(0, 3), st.text(max_size=2))
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
def test_archives_are_what_torch_reads(value, place):
    as_torch_does(saved(value, place=place))


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(values(DTYPES), st.sampled_from(["cpu", "cuda:0"]))
def test_files_from_before_torch_1_6_are_what_torch_reads(value, place):
    as_torch_does(saved(value, archive=False, place=place))


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
def test_what_networks_and_optimisers_save(archive):
    net = torch.nn.Sequential(torch.nn.Conv2d(1, 2, 3), torch.nn.BatchNorm2d(2), torch.nn.Linear(4, 2))
    optimiser = torch.optim.Adam(net.parameters())
    net[0](torch.ones(1, 1, 5, 5)).sum().backward()
    optimiser.step()
    value = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "counts": collections.Counter("aab")}
    as_torch_does(saved(value, archive=archive))


def test_shared_storages_stay_shared():
    x = torch.arange(6.0)
    found = read(saved([x, x[2:], x.view(2, 3).T]))
    assert len({id(each.storage) for each in found}) == 1
    assert np.shares_memory(found[0].array(), found[2].array())


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
def test_a_slice_that_holds_nothing_may_begin_behind_the_end(archive):
    nothing = torch.zeros(1).as_strided((1,), (2,))[1:]
    assert (nothing.storage_offset(), nothing.untyped_storage().nbytes()) == (2, 4)
    as_torch_does(saved(nothing, archive=archive))


def test_a_negated_part_of_complex_numbers():
    part = torch.tensor([1 + 2j, -0.0 + 3j, complex("nan")]).conj().imag
    assert part.is_neg()
    as_torch_does(saved(part))


def test_storages_of_the_other_byte_order():
    numbers = {str(d): torch.arange(7).to(d) for d in DTYPES} | {"x": torch.tensor([1 + 2j])}
    data, swapped = saved(numbers), io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(swapped, "w") as other:
        for entry in archive.infolist():
            is_order = entry.filename.endswith("/byteorder")
            other.writestr(entry.filename, b"big" if is_order else archive.read(entry))
    as_torch_does(swapped.getvalue())


def old_file(value, keys=None, *, protocol=1001):
    """Return a file of the old format, whose storages are given by their persistent ids."""

    class Pickler(pickle.Pickler):
        def persistent_id(self, held):
            return held[1:] if isinstance(held, tuple) and held[:1] == (PERSISTENT,) else None

    stream = io.BytesIO()
    for part in (0x1950A86A20F9469CFC6C, protocol, {"little_endian": True}):
        pickle.dump(part, stream, protocol=2)
    Pickler(stream, protocol=2).dump(value)
    pickle.dump([key for key, _ in keys or []], stream, protocol=2)
    for _, numbers in keys or []:
        stream.write(struct.pack("<q", len(numbers)) + numbers.tobytes())
    return stream.getvalue()


PERSISTENT = "persistent"


class Rebuilt:
    """Pickles as a call of one of torch's functions."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


NUMBERS = np.arange(5, dtype=np.float32)


def whole(*part):
    return PERSISTENT, "storage", torch.FloatStorage, "7", "cuda:0", 5, *(part or (None,))


def test_a_storage_that_is_a_part_of_another_as_before_torch_1_0():
    rebuilt = torch._utils._rebuild_tensor
    parts = [Rebuilt(rebuilt, whole(("8", 1, 3)), 1, (2,), (1,)), Rebuilt(rebuilt, whole(), 0, (5,), (1,))]
    data = old_file(parts, [("7", NUMBERS)])
    as_torch_does(data)
    assert [each.array().tolist() for each in read(data)] == [[2, 3], [0, 1, 2, 3, 4]]


def test_a_file_that_python_2_wrote():
    """Its texts are bytes, its dicts given as lists of pairs, and its storages of a class of CUDA."""
    head, numbers = old_file(0)[:-5].partition(b"}q\x00")[0], b"\x80\x02](U\x017e." + struct.pack("<q", 5)
    value = (
        b"\x80\x02ccollections\nOrderedDict\n](](U\x03fc1ctorch._utils\n_rebuild_tensor\n"
        b"((U\x07storagectorch.cuda\nFloatStorage\nU\x017U\x06cuda:0K\x05NtQK\x00K\x05\x85K\x01\x85tRee\x85R."
    )
    data = head + b"}." + value + numbers + NUMBERS.tobytes()
    as_torch_does(data)
    assert read(data)["fc1"].array().tolist() == NUMBERS.tolist()


OTHER = [
    pytest.param(lambda: torch.eye(3).to_sparse(), ("torch.float32", (3, 3), "torch.sparse_coo", "cpu"), id="sparse"),
    pytest.param(lambda: torch.eye(3).to_sparse_csr(), ("torch.float32", (3, 3), "torch.sparse_csr", "cpu"), id="rows"),
    pytest.param(lambda: torch.zeros(2, device="meta"), ("torch.float32", (2,), "torch.strided", "meta"), id="meta"),
    pytest.param(lambda: torch.ones(2).to(torch.float8_e5m2), ("torch.float8_e5m2", (2,), "torch.strided", "cpu"), id="eight bits"),
    pytest.param(lambda: torch.ones(2).to(torch.complex32), ("torch.complex32", (2,), "torch.strided", "cpu"), id="half complex"),
    pytest.param(lambda: torch._empty_affine_quantized((2,), scale=0.5, zero_point=0, dtype=torch.qint32), ("torch.qint32", (2,), "torch.strided", "cpu"), id="quantised"),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("make", "wanted"), OTHER)
def test_what_numpy_cannot_hold_keeps_its_name(make, wanted):
    found, beside = read(saved([make(), torch.ones(2)]))
    assert (found.dtype, found.shape, found.layout, found.device) == wanted
    assert found.array() is None
    assert beside.array().tolist() == [1, 1]


def test_storages_as_values():
    found = read(saved([torch.ones(2).untyped_storage(), torch.arange(3)._typed_storage()]))
    assert [(each.dtype, each.shape) for each in found] == [("torch.uint8", (8,)), ("torch.int64", (3,))]
    assert found[1].array().tolist() == [0, 1, 2]


# Files that are made to hurt ------------------------------------------------------------------------------------------

DAMAGED = "file 'a.pt': it is damaged, truncated or not a torch file. Write it again."
CODE = "file 'a.pt': it holds objects that would run code when read, so it was not read ({}). Save tensors and plain values only."
FULL = f"file 'a.pt': it holds too many values ({{}} against {MAX_VALUES}). Save numbers as tensors."


def opcodes(*parts):
    """Return an archive whose pickle is these bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", b"\x80\x02" + b"".join(parts) + b".")
    return stream.getvalue()


def tensor(count=4, offset=0, size=(4,), strides=(1,), stored=16, dtype=torch.FloatStorage):
    """Return an archive of one tensor, sizes as stated."""
    value = Rebuilt(
        torch._utils._rebuild_tensor_v2,
        (PERSISTENT, "storage", dtype, "0", "cpu", count),
        offset,
        size,
        strides,
        False,
        {},
    )

    class Pickler(pickle.Pickler):
        def persistent_id(self, held):
            return held[1:] if isinstance(held, tuple) and held[:1] == (PERSISTENT,) else None

    pickled, stream = io.BytesIO(), io.BytesIO()
    Pickler(pickled, protocol=2).dump(value)
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", pickled.getvalue())
        archive.writestr("a/data/0", bytes(stored))
    return stream.getvalue()


def packed(entry_bytes, method=zipfile.ZIP_DEFLATED, claimed=None):
    """Return an archive whose storage is packed, and may claim another size than it has."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(tensor())) as archive, zipfile.ZipFile(stream, "w", method) as other:
        other.writestr("a/data.pkl", archive.read("a/data.pkl"), zipfile.ZIP_STORED)
        other.writestr("a/data/0", entry_bytes)
        if claimed is not None:
            other.filelist[-1].file_size = claimed
    return stream.getvalue()


def as_tar():
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("storages"))
    return stream.getvalue()


def torchscript():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", b"\x80\x02N.")
        archive.writestr("a/constants.pkl", b"\x80\x02N.")
    return stream.getvalue()


def doubling(times):
    """A tuple of twice the one before, named by the memo, again and again."""
    return b")q\x00" + b"".join(b"h\x00\x86q\x00" for _ in range(times))


LONG_LIST = b"](" + b"N" * 900_000 + b"eq\x00"
HURT = [
    pytest.param(lambda: opcodes(b"cposix\nsystem\nX\x02\x00\x00\x00ls\x85R"), CODE.format("posix.system"), id="a command"),
    pytest.param(lambda: opcodes(b"cbuiltins\neval\n"), CODE.format("builtins.eval"), id="a name alone"),
    pytest.param(lambda: opcodes(b"ctorch._utils\n_import_dotted_name\n"), CODE.format("torch._utils._import_dotted_name"), id="of torch"),
    pytest.param(lambda: opcodes(b"cbuiltins\nset\n"), CODE.format("a function"), id="a function as value"),
    pytest.param(lambda: opcodes(b"cos\nsystem\x1b[2J\n"), CODE.format("os.system\\x1b[2J"), id="a name that moves the cursor"),
    pytest.param(lambda: opcodes(b"(S'a'\nios\nsystem\n"), CODE.format("opcode STRING"), id="another opcode"),
    pytest.param(lambda: opcodes(b"(X\x06\x00\x00\x00moduleNNNtQ"), CODE.format("a module"), id="a module"),
    pytest.param(torchscript, "file 'a.pt': it is a TorchScript archive. Save the state_dict() with torch.save.", id="TorchScript"),
    pytest.param(as_tar, "file 'a.pt': it is a tar archive, as torch wrote them before 0.1.10. Load it with an old torch, and save it again.", id="a tar archive"),
    pytest.param(lambda: opcodes(doubling(60)), FULL.format("{}"), id="tuples that double"),
    pytest.param(lambda: opcodes(b"}", doubling(60), b"Ns"), DAMAGED, id="a key that doubles"),
    pytest.param(lambda: opcodes(b"cbuiltins\nset\n](", doubling(60), b"e\x85R"), DAMAGED, id="a set of what doubles"),
    pytest.param(lambda: opcodes(b"]q\x00h\x00a"), DAMAGED, id="a list in itself"),
    pytest.param(lambda: opcodes(b"]q\x00(h\x00h\x00e"), FULL.format("{}"), id="a list twice in itself"),
    pytest.param(lambda: opcodes(b"](" * 50_000 + b"e" * 50_000), DAMAGED, id="deep lists"),
    pytest.param(lambda: opcodes(b")" + b"\x85" * 300), DAMAGED, id="deep tuples"),
    pytest.param(lambda: opcodes(LONG_LIST, b"(" + b"ctorch\nSize\nh\x00\x85R" * 100 + b"t"), FULL.format("{}"), id="long lists copied"),
    pytest.param(lambda: opcodes(LONG_LIST, b"(" + b"h\x00" * 100 + b"t\x86"), FULL.format("{}"), id="long lists again and again"),
    pytest.param(lambda: opcodes(b"(" + b"N" * MAX_VALUES + b"t"), FULL.format("{}"), id="too many"),
    pytest.param(lambda: opcodes(b"X\xff\xff\xff\xffa"), DAMAGED, id="a text that is cut short"),
    pytest.param(lambda: opcodes(b"\x8a\xff" + b"\x7f" * 10), DAMAGED, id="a number that is cut short"),
    pytest.param(lambda: opcodes(b"r\xff\xff\xff\x7f"), DAMAGED, id="a memo of nothing"),
    pytest.param(lambda: opcodes(b"Nr\xff\xff\xff\x7f0"), CODE.format("opcode POP"), id="a memo far off"),
    pytest.param(lambda: opcodes(b"cbuiltins\nbytearray\nJ\xff\xff\xff\x7f\x85R"), DAMAGED, id="bytes by their number"),
    pytest.param(lambda: opcodes(b"}(", *(b"\x8a\x09" + (i * (2**61 - 1)).to_bytes(9, "little") + b"N" for i in range(1, 9)), b"u"), DAMAGED, id="keys of one hash"),
    pytest.param(lambda: tensor(count=10**12), DAMAGED, id="a storage that is less than it says"),
    pytest.param(lambda: tensor(count=-4), DAMAGED, id="a storage of less than nothing"),
    pytest.param(lambda: tensor(size=(5,)), DAMAGED, id="a tensor beyond its storage"),
    pytest.param(lambda: tensor(offset=1), DAMAGED, id="a tensor that begins late"),
    pytest.param(lambda: tensor(offset=-1), DAMAGED, id="a tensor that begins before"),
    pytest.param(lambda: tensor(size=(2, 2), strides=(2, 2)), DAMAGED, id="strides beyond it"),
    pytest.param(lambda: tensor(strides=(-1,)), DAMAGED, id="strides that run back"),
    pytest.param(lambda: tensor(size=(2**62,), strides=(4,)), DAMAGED, id="a product that wraps"),
    pytest.param(lambda: tensor(size=(2**40, 2**40), strides=(0, 0)), DAMAGED, id="more values than are counted"),
    pytest.param(lambda: tensor(size=(1,) * 33, strides=(1,) * 33), DAMAGED, id="too many axes"),
    pytest.param(lambda: tensor(size=(4.0,)), DAMAGED, id="a size that is not whole"),
    pytest.param(lambda: tensor(dtype=torch.DoubleStorage), DAMAGED, id="a storage of wider values"),
    pytest.param(lambda: packed(bytes(4_000_000), claimed=16), DAMAGED, id="an entry that unpacks to more"),
    pytest.param(lambda: packed(bytes(16), zipfile.ZIP_BZIP2), DAMAGED, id="packed by another method"),
    pytest.param(lambda: old_file(0, protocol=1000), DAMAGED, id="another version"),
    pytest.param(lambda: old_file(0, [("7", NUMBERS)]), DAMAGED, id="a storage that nobody has"),
    pytest.param(lambda: old_file([whole()]), DAMAGED, id="a storage that is missing"),
    pytest.param(lambda: old_file([whole()], [("7", NUMBERS[:4])]), DAMAGED, id="a storage of another size"),
    pytest.param(lambda: old_file([whole()], [("7", NUMBERS)])[:-1], DAMAGED, id="a storage that is cut short"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), HURT)
def test_files_that_are_made_to_hurt(make, message):
    data, began = make(), time.process_time()
    found = refusal(data)
    assert time.process_time() - began < 10
    if "{}" in message:
        begin, end = message.split("{}")
        assert found.startswith(begin)
        assert found.endswith(end)
        assert MAX_VALUES < int(found[len(begin) : -len(end)]) <= 2 * MAX_VALUES
    else:
        assert found == message


def test_these_files_are_read_where_nothing_is_wrong():
    assert read(tensor()).array().tolist() == [0, 0, 0, 0]
    assert read(packed(bytes(16))).array().tolist() == [0, 0, 0, 0]
    assert read(opcodes(doubling(4))) == _doubled(4)
    assert read(opcodes(b")" + b"\x85" * 150)) is not None
    assert read(opcodes(LONG_LIST)) == [None] * 900_000
    assert read(old_file([whole()], [("7", NUMBERS)]))[0].array().tolist() == NUMBERS.tolist()


def _doubled(times):
    value = ()
    for _ in range(times):
        value = (value, value)
    return value


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
@pytest.mark.parametrize("step", range(30))
def test_a_file_that_is_cut_or_changed_is_read_or_refused(archive, step):
    data = bytearray(saved({"a": torch.arange(9.0).view(3, 3).T, "b": [1, "two"], "c": torch.ones(2)}, archive=archive))
    chance = np.random.default_rng((step, archive))
    if step % 3 == 0:
        data = data[: int(chance.integers(len(data)))]
    for at in chance.integers(len(data), size=step % 3 * 4):
        data[at] ^= int(chance.integers(1, 256))
    try:
        found = read(bytes(data))
    except InputError:
        return
    for value in found.values() if isinstance(found, dict) else ():
        if isinstance(value, Tensor):
            value.array()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (pickle.dumps({"spikes": [0, 1]}, protocol=4), "it is a pickle that torch.save did not write, and nothing in it was run. Save tensors with torch.save."),
        (pickle.dumps({"spikes": [0, 1]}, protocol=2), "it is a pickle that torch.save did not write, and nothing in it was run. Save tensors with torch.save."),
        (None, "its pickle has a newer protocol than torch's own (4 against 2). Save it with torch.save, without pickle_protocol."),
    ],
    ids=["a plain pickle", "one of torch's protocol", "torch's file with another protocol"],
)  # fmt: skip
def test_a_pickle_of_another_kind_says_what_it_is(data, message):
    if data is None:
        stream = io.BytesIO()
        torch.save({"spikes": torch.zeros(2)}, stream, pickle_protocol=4)
        data = stream.getvalue()
    assert refusal(data) == f"file 'a.pt': {message}"
