"""Files that are made to do harm are refused in one line: bombs, cycles, depth, code, links, pipes, names that print."""

import io
import os
import pickle
import re
import struct
import tracemalloc
import zipfile
from pathlib import Path

import h5py
import nir
import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.errors import MAX_PART, InputError
from hw_model.io.yaml_text import load_yaml
from hw_model.io.zip_directory import MAX_DIRECTORY_BYTES, check_directory
from locsnn_compile.cli.diff import read_report
from locsnn_compile.cli.main import main
from locsnn_compile.data import read_recordings
from locsnn_compile.frontends.slayer.config import read_config as read_slayer_config
from locsnn_compile.training.config import read_config as read_training_config

# Aliases that double sixty times, as in "a billion laughs".
LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 60))
CODE = "model: !!python/object/apply:os.system ['touch ran']\n"
DEEP = "[" * 200_000
MANY = "[" + "1," * 200_000 + "]"
# By id: a text, and the message of all readers of YAML.
OF_YAML = {
    "aliases of aliases": (LAUGHS, "aliases are not read (line 2). Write the value out."),
    "a list that holds itself": (
        "hidden: &a [*a]\n",
        "aliases are not read (line 1). Write the value out.",
    ),
    "a key twice": (
        "hidden: 4\nepochs: 2\nhidden: 8\n",
        "the key 'hidden' is given twice, again at line 3. Keep one.",
    ),
    "a key twice, further in": (
        "a: [{b: 1, c: 2,\n  b: 3}]\n",
        "the key 'b' is given twice, again at line 2. Keep one.",
    ),
    "deep": (DEEP, "it is nested too deeply (more than 50 levels). Correct its brackets."),
    "many": (MANY, "it holds too much (100001 values against 100000). Give a smaller file."),
}
# By id: texts that YAML's own types would turn into objects or errors.
NOT_YAML = {
    "code": CODE,
    "an empty number": "hidden: !!int ''\n",
    "a number that is none": "hidden: !!bool maybe\n",
    "a date that is none": "hidden: !!timestamp soon\n",
    "a list as a key": "? [1]\n: 2\n",
    "digits without end": f"hidden: {'1' * 5000}\n",
    "bytes": b"\xff\xfe\xff\xff\xff",
}
TRAIN = "config 'a.yaml': it is not a YAML file. Write one 'key: value' per line."
SLAYER = "config 'a.yaml': it is not YAML. Give slayerPytorch's network description, or a list of layers."
NO_PROGRAM = "program.yaml: its entries do not make a program. Compile again."
PROGRAM = "program.yaml: the file is not YAML: it is damaged. Compile again."
CHIP = re.compile(
    "a.yaml: (it is not YAML( at line 1)?. Compare it with a chip that ships"
    "|it is not UTF-8 text. Give the path of a chip YAML file)."
)


# Each row: its id, a line of a program's text, what replaces it, and the message.
TEXTS = [
    ("a size of text", "size: 2", "size: two", NO_PROGRAM),
    ("a decay out of range", "decay_u: 4096", "decay_u: 5000", "core 0: its decays do not make a program. Compile it again."),
    ("a decay that is a fraction", "decay_u: 4096", "decay_u: 0.5", "core 0: its decays do not make a program. Compile it again."),
    ("a slice elsewhere", "start: 0", "start: 1", "core 0: its slices do not make a program. Compile it again."),
    ("a key twice", "format: locsnn-program\n", "format: x\nformat: locsnn-program\n", "program.yaml: the key 'format' is given twice, again at line 2. Keep one."),
    ("a phase of no name", "  phase: time\n  compartments", "  phase: never\n  compartments", "core 0: its phases do not make a program. Compile it again."),
    ("an axis that is none", "axis: time", "axis: space", "phases: its axes do not make a program. Compile it again."),
    ("steps without end", "steps: null", "steps: 99999999999", "phases: its steps do not make a program. Compile it again."),
    ("a weight format that is none", "weight_bits: 8", "weight_bits: 7", "core 0: its formats do not make a program. Compile it again."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "message"), [row[1:] for row in TEXTS], ids=[row[0] for row in TEXTS]
)
def test_entries_of_a_program_that_hurt(tmp_path, old, new, message):
    text = (program(tmp_path) / "program.yaml").read_text()
    assert old in text
    write(tmp_path / "program.yaml", text.replace(old, new, 1))
    assert message_of(hw.load_program, tmp_path) == message


def message_of(read, *args):
    """The message with which reading is refused."""
    with pytest.raises(InputError) as caught:
        read(*args)
    return str(caught.value)


def write(path, content):
    """Write a file of text or bytes."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    ("read", "where"),
    [
        (hw.chip, "a.yaml"),
        (read_training_config, "config 'a.yaml'"),
        (read_slayer_config, "config 'a.yaml'"),
    ],
    ids=["chip", "training", "slayer"],
)
@pytest.mark.parametrize(("text", "message"), OF_YAML.values(), ids=list(OF_YAML))
def test_yaml_that_never_ends(tmp_path, read, where, text, message):
    if read is read_slayer_config and text == MANY:
        # This reader takes smaller files: one of almost too many values, which ends in the middle.
        text = "[" + "1," * 99_000 + "1,1,[[[[[" + "1," * 500
        assert message_of(read, write(tmp_path / "a.yaml", text)) == SLAYER
        return
    assert message_of(read, write(tmp_path / "a.yaml", text)) == f"{where}: {message}"


@pytest.mark.parametrize("text", NOT_YAML.values(), ids=list(NOT_YAML))
def test_yaml_that_is_not_what_it_says(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path / "a.yaml", text)
    assert message_of(read_training_config, path) == TRAIN
    assert message_of(read_slayer_config, path) == SLAYER
    assert CHIP.fullmatch(message_of(hw.chip, path))
    program(tmp_path)
    path.replace(tmp_path / "program.yaml")
    assert message_of(hw.load_program, tmp_path) == PROGRAM
    assert not (tmp_path / "ran").exists()


def program(folder):
    """Save a small program of two neurons."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 2)
    h = builder.add_compartments("h", 2, decay_u=4096, decay_v=0, threshold=10)
    builder.connect(x, h, np.eye(2) * 4, weight_bits=8)
    builder.build().save(folder)
    return folder


def with_arrays(folder, change):
    """Replace the arrays of a program, and the checksum that its text has of them."""
    import hashlib

    program(folder)
    with np.load(folder / "program.npz") as arrays:
        content = change(dict(arrays))
    (folder / "program.npz").write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    text = (folder / "program.yaml").read_text()
    write(folder / "program.yaml", re.sub("arrays_sha256: .*", f"arrays_sha256: {digest}", text))


def packed(arrays, **extra):
    """The bytes of a ``.npz`` of these arrays; ``bytes_of`` replaces the content of some."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr(f"{name}.npy", extra.get("bytes_of", {}).get(name, member.getvalue()))
    return stream.getvalue()


def header(shape, descr="<i8"):
    """Return the header of a ``.npy`` file that declares this shape and type."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"shape": shape, "fortran_order": False, "descr": descr}
    )
    return stream.getvalue()


# Each row: its id, a function that makes the bytes of program.npz of its arrays, and the message.
ARRAYS = [
    ("an absurd length", lambda arrays: packed(arrays, bytes_of={"core0/target": header((2**60,))}), "program.npz, 'core0/target.npy': its declared shape is too large (1152921504606846976 against 200000000 values). Give a smaller array."),
    ("a header that is no Python", lambda arrays: packed(arrays, bytes_of={"core0/target": b"\x93NUMPY\x01\x00\x04\x00({['"}), "program.npz, 'core0/target.npy': it is damaged or not a numpy file. Write it again with numpy.save."),
    ("a pickle", lambda arrays: packed(arrays, bytes_of={"core0/target": header((1,), "|O") + pickle.dumps(print)}), "program.npz, 'core0/target.npy': its values are not numbers (dtype object). Write it again with numpy.save."),
    ("less than it says", lambda arrays: packed(arrays, bytes_of={"core0/target": header((50,)) + b"\0" * 392}), "program.npz, 'core0/target.npy': it is truncated (392 of 400 bytes). Write it again with numpy.save."),
    ("floats", lambda arrays: packed(arrays | {"core0/target": np.zeros(2)}), NO_PROGRAM),
    ("a column of biases", lambda arrays: packed(arrays | {"core0/bias_mantissa": np.zeros((2, 1), dtype=np.int64)}), NO_PROGRAM),
    ("no archive", lambda arrays: b"PK", NO_PROGRAM),
    ("weights of other synapses", lambda arrays: packed(arrays | {"core0/mantissa": np.arange(7)}), "core 0: its synapse tables do not make a program. Compile it again."),
    ("profiles of another number", lambda arrays: packed(arrays | {"core0/profile": np.zeros(5, dtype=np.int64)}), "core 0: its compartment tables do not make a program. Compile it again."),
    ("a weight too large", lambda arrays: packed(arrays | {"core0/mantissa": np.array([4, 2**40])}), "core 0: its weights do not make a program. Compile it again."),
    ("a bias shifted too far", lambda arrays: packed(arrays | {"core0/bias_exponent": np.array([0, 64])}), "core 0: its bias exponents do not make a program. Compile it again."),
    ("a line that is not there", lambda arrays: packed(arrays | {"input0/line": np.array([0, 2])}), "input 'x': its lines do not make a program. Compile it again."),
    ("two lines to one axon", lambda arrays: packed(arrays | {"input0/axon": np.array([0, 0])}), "core 0: its input axons do not make a program. Compile it again."),
    ("a route that ends early", lambda arrays: packed(arrays | {"input0/axon": np.array([0])}), "input 'x': its routes do not make a program. Compile it again."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"), [row[1:] for row in ARRAYS], ids=[row[0] for row in ARRAYS]
)
def test_arrays_of_a_program_that_hurt(tmp_path, change, message):
    with_arrays(tmp_path, change)
    assert message_of(hw.load_program, tmp_path) == message


def large_directory(path, *, wide):
    """Write an archive whose end claims a directory of a terabyte beside one of no byte, or of 4 GB less a byte."""
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 1, 1, 0 if wide else 2**32 - 1, 0, 0)
    if wide:
        end64 = struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, 1, 1, 2**40, 0)
        end = end64 + struct.pack("<4sLQL", b"PK\x06\x07", 0, 0, 1) + end
    path.write_bytes(b"\0" * 100 + end)


@pytest.mark.parametrize("wide", [False, True], ids=["32 bits", "64 bits"])
def test_archives_that_claim_a_huge_directory(tmp_path, wide):
    large_directory(tmp_path / "a.zip", wide=wide)
    refused = r"^a directory of \d+ bytes$|^Corrupt zip64 end of central directory record$"  # the latter from Python 3.12
    with (
        (tmp_path / "a.zip").open("rb") as stream,
        pytest.raises((ValueError, zipfile.BadZipFile), match=refused),
    ):
        check_directory(stream)
    for name, what in (
        (
            "a.zip",
            "archive 'a.zip': it is damaged, truncated or not a zip archive. Fetch the archive again.",
        ),
        (
            "a.npz",
            "file 'a.npz': it is damaged, truncated or not a .npz file. Write it again with numpy.savez.",
        ),
        (
            "a.pt",
            "file 'a.pt': it is damaged, truncated or not a torch file. Write it again with torch.save.",
        ),
    ):
        large_directory(tmp_path / name, wide=wide)
        assert message_of(read_recordings, tmp_path / name) == what


def test_archives_of_a_usual_directory_pass(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a", b"PK\x05\x06" + b"\xff" * 18)  # looks like the end of an archive
        archive.comment = b"c" * 60_000
    with (tmp_path / "a.zip").open("rb") as stream:
        check_directory(stream)
        assert stream.tell() == 0
    assert MAX_DIRECTORY_BYTES > 100_000 * 100


def test_what_is_no_archive_passes():
    check_directory(io.BytesIO(b"no end of an archive"))


def test_an_archive_that_unpacks_to_far_more(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for i in range(17):
            archive.writestr(f"sample_{i}.npy", b"")
            # The directory says so; the sizes are looked at before anything is unpacked.
            archive.filelist[-1].file_size = 99_000_000
    assert message_of(read_recordings, tmp_path / "a.zip") == (
        "archive 'a.zip': its recordings are too large together (1683000000 against 1600000000). Give fewer."
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize(
    ("name", "entry", "message"),
    [
        (
            "a.npz",
            "spikes.npy",
            "file 'a.npz': it is damaged, truncated or not a .npz file. Write it again with numpy.savez.",
        ),
        (
            "a.zip",
            "sample_0.npy",
            "archive 'a.zip', 'sample_0.npy': it is damaged. Fetch the archive again.",
        ),
        (
            "a.pt",
            "a/data.pkl",
            "file 'a.pt': it is damaged, truncated or not a torch file. Write it again with torch.save.",
        ),
    ],
)
def test_an_entry_that_claims_a_byte_is_not_unpacked_whole(tmp_path, name, entry, message, method):
    with zipfile.ZipFile(tmp_path / name, "w", method) as archive:
        archive.writestr(entry, bytes(60_000_000))
        archive.filelist[-1].file_size = 1
    tracemalloc.start()
    try:
        assert message_of(read_recordings, tmp_path / name) == message
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_member_without_a_name(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(zipfile.ZipInfo(""), b"x")
    assert message_of(read_recordings, tmp_path / "a.zip") == (
        "archive 'a.zip': no recordings inside. Give sample_<i>.npy or sample_<i>_label_<k>.npy files, or one .npz file."
    )


def test_members_that_name_places_elsewhere_are_read_where_they_are(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("../../sample_0.npy", packed_npy(np.ones((2, 3), dtype=np.uint8)))
    assert read_recordings(tmp_path / "a.zip").spikes.shape == (1, 3, 2)
    assert [file.name for file in tmp_path.iterdir()] == ["a.zip"]


def packed_npy(array):
    """Return the bytes of a ``.npy`` file."""
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


# Each row: its id, the name of the pipe, a function that reads it, and the message.
PIPES = [
    ("events", "a.npy", lambda path: read_recordings(path), "file 'a.npy': it is not a plain file. Write it to a file first."),
    ("a model", "a.nir", lambda path: lc.load(path), "model 'a.nir': it is not a plain file. Write it to a file first."),
    ("a chip", "a.yaml", lambda path: hw.chip(path), "a.yaml: it is not a plain file. Write it to a file first."),
    ("a configuration", "a.yaml", lambda path: read_training_config(path), "config 'a.yaml': it is not a plain file. Write it to a file first."),
    ("a report", "report.json", lambda path: read_report(path.parent), "build 'NAME', report.json: it is not a plain file. Write it to a file first."),
    ("a program", "program.yaml", lambda path: hw.load_program(path.parent), "program 'PATH', program.yaml: it is not a plain file. Write it to a file first."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "read", "message"), [row[1:] for row in PIPES], ids=[row[0] for row in PIPES]
)
def test_a_pipe_that_nobody_writes_to(tmp_path, name, read, message):
    os.mkfifo(tmp_path / name)
    assert message_of(read, tmp_path / name) == message.replace("NAME", tmp_path.name).replace(
        "PATH", str(tmp_path)
    )


def test_names_that_would_move_the_cursor_are_written_out(tmp_path):
    np.savez(tmp_path / "a.npz", **{"\x1b[2J": np.zeros(1), "\u202eb": np.zeros(1)})
    assert message_of(read_recordings, tmp_path / "a.npz") == (
        "file 'a.npz': it is not clear which entry holds the recordings (entries: \\x1b[2J, \\u202eb). "
        "Name the entry 'spikes'."
    )


def test_names_that_never_end_are_cut(tmp_path):
    path = write(tmp_path / "a.yaml", f"? {'x' * 3000}\n: 1\n")
    message = message_of(read_training_config, path)
    assert message.startswith(f"config 'a.yaml': unknown key '{'x' * 60}'. Choose one of: ")
    assert str(InputError("a", "x" * 3000, fix="Stop.")) == f"a: {'x' * MAX_PART}.... Stop."


def test_hdf5_that_the_library_does_not_come_to_the_end_of(tmp_path, monkeypatch):
    from locsnn_compile.data.hdf5 import probe as hdf5_probe

    monkeypatch.setattr(hdf5_probe, "CPU_SECONDS", 1)
    whole = tmp_path / "a.nir"
    with h5py.File(whole, "w") as file:
        file["version"] = "1.0"
    assert hdf5_probe.outcome(whole.read_bytes()) == hdf5_probe.SURVIVED
    assert hdf5_probe.outcome(b"no HDF5 at all") == hdf5_probe.SURVIVED


def test_a_pool_of_less_than_nothing(tmp_path):
    size = np.array([-2, -2])
    pool = nir.SumPool2d(kernel_size=size, stride=np.array([1, 1]), padding=np.array([0, 0]))
    fires = nir.IF(
        r=np.ones((1, 3, 3)), v_threshold=np.ones((1, 3, 3)), v_reset=np.zeros((1, 3, 3))
    )
    ends = {"input": nir.Input(np.array([1, 4, 4])), "output": nir.Output(np.array([1, 3, 3]))}
    edges = [("input", "pool"), ("pool", "if"), ("if", "output")]
    graph = nir.NIRGraph(ends | {"pool": pool, "if": fires}, edges, type_check=False)
    nir.write(tmp_path / "a.nir", graph)
    assert message_of(lc.load, tmp_path / "a.nir") == (
        "model 'a.nir', node 'pool': its kernel is smaller than 1 ((-2, -2)). Correct it."
    )


def test_a_crash_of_the_library_is_a_damaged_file(tmp_path, monkeypatch):
    from locsnn_compile.data.hdf5 import read as hdf5

    with h5py.File(tmp_path / "a.nir", "w") as file:
        file["version"] = "1.0"
    monkeypatch.setattr(hdf5, "library_survives", lambda data: False)
    assert message_of(lc.load, tmp_path / "a.nir") == (
        "model 'a.nir': it is damaged, truncated or not an HDF5 file. Give a whole file, or write it again."
    )


def test_a_build_of_strange_texts_is_compared(tmp_path, capfd):
    program(tmp_path)
    write(
        tmp_path / "report.json",
        '{"schema": "locsnn-report/1", "model": {"name": "\\ud800\\u001b[2J"}}',
    )
    other = program(tmp_path / "b")
    write(other / "report.json", '{"schema": "locsnn-report/1", "model": {"name": "b"}}')
    assert main(["diff", "--all", str(tmp_path), str(other)]) == 0
    assert "\ud800" not in capfd.readouterr().out


def test_safe_text_is_what_the_loader_says():
    text = "a: [1, {b: c}]\nd: !!str 1\n"
    assert load_yaml(text, "x") == yaml.safe_load(text)


@pytest.mark.parametrize(
    "text", ["1e", "e1", "1e5x", "0x1e", "1.2.3e4", "e", "-", "1_0e3", "2026-01-01", "'1e-3'"]
)
def test_text_that_looks_like_an_exponent(text):
    assert repr(load_yaml(text, "x")) == repr(yaml.safe_load(text))
    assert Path(hw.__file__).is_file()
