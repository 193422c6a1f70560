"""Torch files that are hostile, damaged or of another kind are read, or refused in one line, within little time and memory.

A torch file is a zip archive of a pickle and the bytes of its tensors (storages), or, before torch 1.6, pickles and bytes
in a row. The reader interprets only the opcodes that plain values and tensors need. ``MAX_VALUES`` bounds the values that
a small pickle can expand to.
"""

import io
import pickle
import tarfile
import time
import zipfile

import numpy as np
import pytest
import torch

from locsnn_compile.data.plain_pickle import MAX_VALUES
from locsnn_compile.data.tensors import Tensor
from locsnn_compile.errors import InputError
from tests.support.torch_files import (
    NUMBERS,
    PERSISTENT,
    Pickler,
    Rebuilt,
    old_file,
    read,
    refusal,
    saved,
    storage_id,
)

DAMAGED = "file 'a.pt': it is damaged, truncated or not a torch file. Write it again."
CODE = "file 'a.pt': it contains objects that would run code when read, so it was not read ({}). Save tensors and plain values only."
FULL = (
    f"file 'a.pt': it holds too many values ({{}} against {MAX_VALUES}). Save numbers as tensors."
)


def opcodes(*parts):
    """Return an archive whose pickle consists of these bytes, opcodes of the pickle machine."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", b"\x80\x02" + b"".join(parts) + b".")
    return stream.getvalue()


def tensor(count=4, offset=0, size=(4,), strides=(1,), stored=16, dtype=torch.FloatStorage):
    """Return an archive of one tensor of these sizes; ``stored`` are the bytes of its storage."""
    value = Rebuilt(
        torch._utils._rebuild_tensor_v2,
        (PERSISTENT, "storage", dtype, "0", "cpu", count),
        offset,
        size,
        strides,
        False,
        {},
    )

    pickled = io.BytesIO()
    stream = io.BytesIO()
    Pickler(pickled, protocol=2).dump(value)
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", pickled.getvalue())
        archive.writestr("a/data/0", bytes(stored))
    return stream.getvalue()


def packed(entry_bytes, method=zipfile.ZIP_DEFLATED, claimed=None):
    """Return an archive of a tensor whose storage is compressed, and may claim another size than it has."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(tensor())) as archive,
        zipfile.ZipFile(stream, "w", method) as other,
    ):
        other.writestr("a/data.pkl", archive.read("a/data.pkl"), zipfile.ZIP_STORED)
        other.writestr("a/data/0", entry_bytes)
        if claimed is not None:
            other.filelist[-1].file_size = claimed
    return stream.getvalue()


def as_tar():
    """Return a tar archive, the oldest format of torch."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("storages"))
    return stream.getvalue()


def torchscript():
    """Return an archive with the entries of a TorchScript module."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a/data.pkl", b"\x80\x02N.")
        archive.writestr("a/constants.pkl", b"\x80\x02N.")
    return stream.getvalue()


def doubling(times):
    """Return opcodes for a tuple that holds the previous tuple twice, ``times`` over: few bytes, 2^times values.

    The memo of the pickle machine keeps the previous tuple.
    """
    return b")q\x00" + b"".join(b"h\x00\x86q\x00" for _ in range(times))


LONG_LIST = b"](" + b"N" * 900_000 + b"eq\x00"
"""Opcodes of a list of 900,000 times None, fewer than ``MAX_VALUES``, which the memo keeps."""

# Opcodes of the pickle machine that stand below:
#
#     N None   ) empty tuple   ] empty list   } empty dict   X, S a text   J, \x8a a number
#     ( mark   t tuple of all above the mark   e, u append or set all above the mark   a append   s set
#     \x85, \x86 tuple of the topmost one or two   q, r keep in the memo   h take from the memo   0 drop
#     c function or class by module and name   i, R call it   Q storage by its persistent id
HURT = [
    pytest.param(
        lambda: opcodes(b"cposix\nsystem\nX\x02\x00\x00\x00ls\x85R"),
        CODE.format("posix.system"),
        id="a command",
    ),
    pytest.param(
        lambda: opcodes(b"cbuiltins\neval\n"), CODE.format("builtins.eval"), id="a name alone"
    ),
    pytest.param(
        lambda: opcodes(b"ctorch._utils\n_import_dotted_name\n"),
        CODE.format("torch._utils._import_dotted_name"),
        id="of torch",
    ),
    pytest.param(
        lambda: opcodes(b"cbuiltins\nset\n"), CODE.format("a function"), id="a function as value"
    ),
    pytest.param(
        lambda: opcodes(b"cos\nsystem\x1b[2J\n"),
        CODE.format("os.system\\x1b[2J"),
        id="a name that moves the cursor",
    ),
    pytest.param(
        lambda: opcodes(b"(S'a'\nios\nsystem\n"), CODE.format("opcode STRING"), id="another opcode"
    ),
    pytest.param(
        lambda: opcodes(b"(X\x06\x00\x00\x00moduleNNNtQ"), CODE.format("a module"), id="a module"
    ),
    pytest.param(
        torchscript,
        "file 'a.pt': it is a TorchScript archive. Save the state_dict() with torch.save.",
        id="TorchScript",
    ),
    pytest.param(
        as_tar,
        "file 'a.pt': it is a tar archive, as torch wrote them before 0.1.10. "
        "Load it with an old torch, and save it again.",
        id="a tar archive",
    ),
    pytest.param(lambda: opcodes(doubling(60)), FULL.format("{}"), id="tuples that double"),
    pytest.param(lambda: opcodes(b"}", doubling(60), b"Ns"), DAMAGED, id="a key that doubles"),
    pytest.param(
        lambda: opcodes(b"cbuiltins\nset\n](", doubling(60), b"e\x85R"),
        DAMAGED,
        id="a set of what doubles",
    ),
    pytest.param(lambda: opcodes(b"]q\x00h\x00a"), DAMAGED, id="a list in itself"),
    pytest.param(
        lambda: opcodes(b"]q\x00(h\x00h\x00e"), FULL.format("{}"), id="a list twice in itself"
    ),
    pytest.param(lambda: opcodes(b"](" * 50_000 + b"e" * 50_000), DAMAGED, id="deep lists"),
    pytest.param(lambda: opcodes(b")" + b"\x85" * 300), DAMAGED, id="deep tuples"),
    pytest.param(
        lambda: opcodes(LONG_LIST, b"(" + b"ctorch\nSize\nh\x00\x85R" * 100 + b"t"),
        FULL.format("{}"),
        id="long lists copied",
    ),
    pytest.param(
        lambda: opcodes(LONG_LIST, b"(" + b"h\x00" * 100 + b"t\x86"),
        FULL.format("{}"),
        id="long lists again and again",
    ),
    pytest.param(
        lambda: opcodes(b"(" + b"N" * MAX_VALUES + b"t"), FULL.format("{}"), id="too many"
    ),
    pytest.param(lambda: opcodes(b"X\xff\xff\xff\xffa"), DAMAGED, id="a text that is cut short"),
    pytest.param(
        lambda: opcodes(b"\x8a\xff" + b"\x7f" * 10), DAMAGED, id="a number that is cut short"
    ),
    pytest.param(lambda: opcodes(b"r\xff\xff\xff\x7f"), DAMAGED, id="a memo of nothing"),
    pytest.param(
        lambda: opcodes(b"Nr\xff\xff\xff\x7f0"), CODE.format("opcode POP"), id="a memo far off"
    ),
    pytest.param(
        lambda: opcodes(b"cbuiltins\nbytearray\nJ\xff\xff\xff\x7f\x85R"),
        DAMAGED,
        id="bytes by their number",
    ),
    pytest.param(
        lambda: opcodes(
            b"}(",
            *(b"\x8a\x09" + (i * (2**61 - 1)).to_bytes(9, "little") + b"N" for i in range(1, 9)),
            b"u",
        ),
        DAMAGED,
        id="keys of one hash",
    ),
    pytest.param(lambda: tensor(count=10**12), DAMAGED, id="a storage that is less than it says"),
    pytest.param(lambda: tensor(count=-4), DAMAGED, id="a storage of less than nothing"),
    pytest.param(lambda: tensor(size=(5,)), DAMAGED, id="a tensor beyond its storage"),
    pytest.param(lambda: tensor(offset=1), DAMAGED, id="a tensor that begins late"),
    pytest.param(lambda: tensor(offset=-1), DAMAGED, id="a tensor that begins before"),
    pytest.param(lambda: tensor(size=(2, 2), strides=(2, 2)), DAMAGED, id="strides beyond it"),
    pytest.param(lambda: tensor(strides=(-1,)), DAMAGED, id="strides that run back"),
    pytest.param(lambda: tensor(size=(2**62,), strides=(4,)), DAMAGED, id="a product that wraps"),
    pytest.param(
        lambda: tensor(size=(2**40, 2**40), strides=(0, 0)),
        DAMAGED,
        id="more values than are counted",
    ),
    pytest.param(lambda: tensor(size=(1,) * 33, strides=(1,) * 33), DAMAGED, id="too many axes"),
    pytest.param(lambda: tensor(size=(4.0,)), DAMAGED, id="a size that is not whole"),
    pytest.param(
        lambda: tensor(dtype=torch.DoubleStorage), DAMAGED, id="a storage of wider values"
    ),
    pytest.param(
        lambda: packed(bytes(4_000_000), claimed=16), DAMAGED, id="an entry that unpacks to more"
    ),
    pytest.param(
        lambda: packed(bytes(16), zipfile.ZIP_BZIP2), DAMAGED, id="packed by another method"
    ),
    pytest.param(lambda: old_file(0, protocol=1000), DAMAGED, id="another version"),
    pytest.param(lambda: old_file(0, [("7", NUMBERS)]), DAMAGED, id="a storage that nobody has"),
    pytest.param(lambda: old_file([storage_id()]), DAMAGED, id="a storage that is missing"),
    pytest.param(
        lambda: old_file([storage_id()], [("7", NUMBERS[:4])]),
        DAMAGED,
        id="a storage of another size",
    ),
    pytest.param(
        lambda: old_file([storage_id()], [("7", NUMBERS)])[:-1],
        DAMAGED,
        id="a storage that is cut short",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("make", "message"), HURT)
def test_hostile_files_are_refused_in_little_time(make, message):
    """A ``{}`` in the message stands for the number of values, which is just above the limit."""
    data = make()
    start_seconds = time.process_time()
    refused_with = refusal(data)
    assert time.process_time() - start_seconds < 10
    if "{}" in message:
        before, after = message.split("{}")
        assert refused_with.startswith(before)
        assert refused_with.endswith(after)
        assert MAX_VALUES < int(refused_with[len(before) : -len(after)]) <= 2 * MAX_VALUES
    else:
        assert refused_with == message


@pytest.mark.slow
def test_similar_files_without_a_fault_are_read():
    assert read(tensor()).array().tolist() == [0, 0, 0, 0]
    assert read(packed(bytes(16))).array().tolist() == [0, 0, 0, 0]
    assert read(opcodes(doubling(4))) == _doubled(4)
    assert read(opcodes(b")" + b"\x85" * 150)) is not None
    assert read(opcodes(LONG_LIST)) == [None] * 900_000
    assert read(old_file([storage_id()], [("7", NUMBERS)]))[0].array().tolist() == NUMBERS.tolist()


def _doubled(times):
    value = ()
    for _ in range(times):
        value = (value, value)
    return value


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "old"])
@pytest.mark.parametrize("step", range(30))
def test_a_file_that_is_cut_or_changed_is_read_or_refused(archive, step):
    data = bytearray(
        saved(
            {"a": torch.arange(9.0).view(3, 3).T, "b": [1, "two"], "c": torch.ones(2)},
            archive=archive,
        )
    )
    rng = np.random.default_rng((step, archive))
    if step % 3 == 0:
        data = data[: int(rng.integers(len(data)))]
    for position in rng.integers(len(data), size=step % 3 * 4):
        data[position] ^= int(rng.integers(1, 256))
    try:
        content = read(bytes(data))
    except InputError:
        return
    # What is read can be used.
    if isinstance(content, dict):
        for value in content.values():
            if isinstance(value, Tensor):
                value.array()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            pickle.dumps({"spikes": [0, 1]}, protocol=4),
            "it is a pickle that torch.save did not write, and nothing in it was run. "
            "Save tensors with torch.save.",
        ),
        (
            pickle.dumps({"spikes": [0, 1]}, protocol=2),
            "it is a pickle that torch.save did not write, and nothing in it was run. "
            "Save tensors with torch.save.",
        ),
        (
            None,
            "its pickle has a newer protocol than torch's own (4 against 2). "
            "Save it with torch.save, without pickle_protocol.",
        ),
    ],
    ids=["a plain pickle", "one of torch's protocol", "torch's file with another protocol"],
)
def test_the_error_says_which_other_kind_of_pickle_it_is(data, message):
    if data is None:
        stream = io.BytesIO()
        torch.save({"spikes": torch.zeros(2)}, stream, pickle_protocol=4)
        data = stream.getvalue()
    assert refusal(data) == f"file 'a.pt': {message}"
