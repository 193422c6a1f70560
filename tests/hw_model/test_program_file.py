"""Programs on disk: what is written is read back, and what is damaged is refused by name."""

import re
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_engines import SMALL, random_program

import hw_model as hw
from hw_model.program_file import program_files


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_loaded_program_is_the_saved_one(seed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("program")
    program, _, _, spikes = random_program(seed, SMALL)
    program.save(folder)
    loaded = hw.load_program(folder)
    assert program_files(loaded) == program_files(program)
    before, after = (hw.simulate(p, spikes, probe=("spikes", "u", "v")) for p in (program, loaded))
    assert before.counts == after.counts
    assert all(np.array_equal(before.v[name], after.v[name]) for name in before.v)


@pytest.fixture
def saved(tmp_path):
    program, *_ = random_program(1)
    program.save(tmp_path)
    return tmp_path


def replace_in(path, old, new):
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text, count=1))


def swap_arrays(folder):
    other, *_ = random_program(2)
    (folder / "program.npz").write_bytes(program_files(other)["program.npz"])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda f: (f / "program.npz").unlink(),
            "program.npz: cannot be read: No such file or directory. Give the folder that the compiler wrote.",
        ),
        (
            lambda f: (f / "program.npz").write_bytes((f / "program.npz").read_bytes()[:-7]),
            "program.npz: the checksum differs: it is damaged, or of another program. Compile again.",
        ),
        (swap_arrays, "program.npz: the checksum differs: it is damaged, or of another program. Compile again."),
        (
            lambda f: (f / "program.yaml").write_text("cores: ["),
            "program.yaml: the file is not YAML: it is damaged. Compile again.",
        ),
        (
            lambda f: (f / "program.yaml").write_text("- a list"),
            "program.yaml: this is not a program. Give the folder that the compiler wrote.",
        ),
        (
            lambda f: replace_in(f / "program.yaml", "version: 1", "version: 2"),
            "program.yaml: the program has another format version (2 against 1). "
            "Compile it again, or use the release that wrote it.",
        ),
        (
            lambda f: replace_in(f / "program.yaml", "decay_u: \\d+", "decay_q: 1"),
            "program.yaml: its entries do not make a program. Compile again.",
        ),
        (
            lambda f: replace_in(
                f / "program.yaml", "weight_bits: \\d+", "weight_bits: !!python/object/apply:os.system [id]"
            ),
            "program.yaml: the file is not YAML: it is damaged. Compile again.",
        ),
    ],
    ids=["missing", "truncated", "swapped", "no yaml", "no program", "newer", "unknown key", "code"],
)
def test_damage_is_refused_by_name(saved, damage, message):
    damage(saved)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == message


def test_arrays_carry_no_time_stamp(saved):
    with zipfile.ZipFile(saved / "program.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
