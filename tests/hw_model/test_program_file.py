"""Programs on disk: a saved program is loaded unchanged, and each kind of damage is refused with its whole message.

The documented format is read by a few lines of the test's own, without the package.
"""

import hashlib
import math
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.program.sealed import sealed_files
from hw_model.program.write import program_files
from tests.support.random_programs import SMALL, random_program


@pytest.mark.parametrize(
    ("name", "read"),
    [("a\x85b", "a\x85b"), ("a\u2028b", "a\u2028b"), ("a\r\nb", "a\r\nb"), (" a: #b ", " a: #b "), ("null", "null"), ("", ""), ("a\ud800b", "a\\ud800b")],
    ids=["next line", "line separator", "line break", "YAML's own characters", "a word of YAML", "empty", "half a pair, which no file holds"],
)  # fmt: skip
def test_odd_names_are_read_back(name, read, tmp_path):
    b = hw.ProgramBuilder(hw.chip("tiny-sim"), name=f"p{name}")
    x = b.add_input(f"x{name}", 1)
    y = b.add_compartments(name, 1, threshold=1)
    b.connect(x, y, [[2]])
    b.read_out(y)
    b.build().save(tmp_path)
    loaded = hw.load_program(tmp_path)
    assert (loaded.name, loaded.inputs[0].name, list(loaded.populations)) == (
        f"p{read}",
        f"x{read}",
        [read],
    )
    assert loaded.readout.populations == (read,)


@settings(max_examples=15, deadline=None)
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
    """A folder with a saved program."""
    program, *_ = random_program(1)
    program.save(tmp_path)
    return tmp_path


def replace_in(path, old, new):
    """Replace the first match of a pattern in a file; there must be one."""
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text, count=1))


def swap_arrays(folder):
    """Replace the arrays of a program by those of another one."""
    other, *_ = random_program(2)
    (folder / "program.npz").write_bytes(program_files(other)["program.npz"])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda f: (f / "program.npz").unlink(),
            "program '{folder}', program.npz: it cannot be read (No such file or directory). "
            "Give the folder that the compiler wrote.",
        ),
        (
            lambda f: (f / "program.npz").write_bytes((f / "program.npz").read_bytes()[:-7]),
            "program.npz: the checksum differs: it is damaged, or of another program. Compile again.",
        ),
        (
            swap_arrays,
            "program.npz: the checksum differs: it is damaged, or of another program. Compile again.",
        ),
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
            lambda f: replace_in(f / "program.yaml", "phases:", "class_names: slide\nphases:"),
            "program.yaml: its entries do not make a program. Compile again.",
        ),
        (
            lambda f: replace_in(
                f / "program.yaml",
                "weight_bits: \\d+",
                "weight_bits: !!python/object/apply:os.system [id]",
            ),
            "program.yaml: the file is not YAML: it is damaged. Compile again.",
        ),
    ],
    ids=[
        "missing",
        "truncated",
        "swapped",
        "no yaml",
        "no program",
        "newer",
        "unknown key",
        "names that are no list",
        "code",
    ],
)
def test_damage_is_refused_with_its_kind(saved, damage, message):
    damage(saved)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == message.replace("{folder}", str(saved))


EDITED = (
    "program.yaml: its checksum differs: it was edited, or is damaged. "
    "Compile again or, to play it as edited, remove its last line."
)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("threshold_mantissas:\n  - \\d+", "threshold_mantissas:\n  - 77"),
        ("synapses_pruned: \\d+", "synapses_pruned: 12345"),
        ("SHA-256 of all above: .", "SHA-256 of all above: x"),
    ],
    ids=["threshold", "a count", "the checksum itself"],
)
def test_an_edited_program_is_refused_until_its_checksum_is_removed(saved, old, new):
    path = saved / "program.yaml"
    replace_in(path, old, new)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == EDITED
    *lines, last = path.read_text().splitlines(keepends=True)
    assert last.startswith("# SHA-256 of all above: ")
    path.write_text("".join(lines))
    hw.load_program(saved)


def test_lines_may_end_as_on_windows(saved):
    path = saved / "program.yaml"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    hw.load_program(saved)


def test_arrays_carry_no_time_stamp(saved):
    with zipfile.ZipFile(saved / "program.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_page_names_every_field_and_array(saved):
    page = (Path(__file__).parents[2] / "docs/reference/program-format.md").read_text()
    documented = set(re.findall(r"`([a-z_0-9]+)`", page))
    document = yaml.safe_load((saved / "program.yaml").read_text())
    core = document["cores"][0]
    written = {*document, *document["phases"][0], *document["inputs"][0], *core, *core["slices"][0]}
    written |= {*core["compartment_profiles"][0], *core["synapse_formats"][0]}
    with np.load(saved / "program.npz") as arrays:
        written |= {name.split("/")[1] for name in arrays.files}
    assert written <= documented


def test_a_reader_that_knows_only_the_page_finds_every_weight(saved):
    """The files alone, without hw_model, give each source's effective weights and delays as they were connected."""
    _, _, links, _ = random_program(1)
    document = yaml.safe_load((saved / "program.yaml").read_text())
    arrays = dict(np.load(saved / "program.npz"))
    names = {}
    for core in document["cores"]:
        for piece in core["slices"]:
            for i in range(piece["stop"] - piece["start"]):
                names[core["number"], piece["offset"] + i] = (piece["group"], piece["start"] + i)
    read_from_files = []

    def follow(source, k, axon):
        core = {
            key.split("/")[1]: value for key, value in arrays.items() if key.startswith(f"core{k}/")
        }
        for row in range(core["list_start"][axon], core["list_start"][axon + 1]):
            exponent = document["cores"][k]["synapse_formats"][core["format_index"][row]][
                "exponent"
            ]
            weight = 64 * math.floor(int(core["mantissa"][row]) * 2.0**exponent)
            read_from_files.append(
                (source, names[k, core["target"][row]], weight, int(core["delay"][row]))
            )

    for k, item in enumerate(document["inputs"]):
        for line, core, axon in zip(
            *(arrays[f"input{k}/{n}"] for n in ("line", "core", "axon")), strict=True
        ):
            follow((item["name"], int(line)), int(core), axon)
    for core in document["cores"]:
        sent = (
            arrays[f"core{core['number']}/{n}"] for n in ("out_compartment", "out_core", "out_axon")
        )
        for compartment, to_core, axon in zip(*sent, strict=True):
            follow(names[core["number"], compartment], int(to_core), axon)
    expected = [
        (
            (k["source"], j),
            (k["target"], i),
            64 * math.floor(k["weights"][i, j] * 2.0 ** k["exponent"]),
            k["delay"][i, j],
        )
        for k in links
        for i, j in zip(*np.nonzero(k["weights"]), strict=True)
    ]
    assert sorted(read_from_files) == sorted(expected)


def two_classes(**readout) -> hw.ChipProgram:
    """Return a program of two populations of two compartments each, with such a readout."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 1)
    for name in ("y", "z"):
        builder.connect(x, builder.add_compartments(name, 2, threshold=1), [[2], [2]])
    return replace(builder.build(), readout=Readout(("y", "z"), (1.0, 2.0), **readout))


@pytest.mark.parametrize(
    "readout",
    [
        {},
        {"potentials_from": 3},
        {"potentials_from": (3, None)},
        {"potentials_from": (0, 4)},
        {"tie_class": 1},
    ],
    ids=["spikes", "potentials", "potentials and spikes", "two first steps", "a class for ties"],
)
def test_a_readout_is_read_back(readout, tmp_path):
    program = two_classes(**readout)
    program.save(tmp_path)
    assert hw.load_program(tmp_path).readout == program.readout


@pytest.mark.parametrize(
    ("more", "measured"),
    [(["core9/extra"], "core9/extra"), (["a", "b", "c"], "a and 2 more")],
    ids=["one", "three"],
)
def test_arrays_without_a_meaning_are_refused_by_name(saved, more, measured):
    arrays = saved / "program.npz"
    text = saved / "program.yaml"
    with np.load(arrays) as stored:
        extended = {**stored, **{name: np.zeros(1, dtype=np.int64) for name in more}}
    before = hashlib.sha256(arrays.read_bytes()).hexdigest()
    np.savez(arrays, **extended)
    document = text.read_text().replace(before, hashlib.sha256(arrays.read_bytes()).hexdigest())
    text.write_text(document[: document.rindex("# SHA-256")])
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == (
        f"program.npz: it holds arrays without a meaning ({measured}). Compile again."
    )


def test_texts_are_written_as_they_are_and_lines_break_at_the_first_blank_after_120_characters():
    """The words have 9 characters: with 11 of them, the first line has 121."""
    words = ["ninechars"] * 13
    entries = {"name": "Größe", "provenance": " ".join(words)}
    files = sealed_files("locsnn-program", 1, entries, {})
    *_, name, first, second, _ = files["program.yaml"].decode().splitlines()
    assert (name, first, second) == (
        "name: Größe",
        f"provenance: {' '.join(words[:11])}",
        f"  {' '.join(words[11:])}",
    )


def test_files_of_more_than_two_gibibytes_are_not_read(saved):
    """The file is sparse, so that it takes no space."""
    most = 2 << 30
    with (saved / "program.npz").open("r+b") as file:
        file.truncate(most + 1)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == (
        f"program '{saved}', program.npz: it is too large ({most + 1} bytes against {most}). Compile again."
    )


def test_a_file_of_an_unknown_kind_is_no_program(saved):
    replace_in(saved / "program.yaml", "format: locsnn-program", "format: recipe")
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(saved)
    assert str(caught.value) == (
        "program.yaml: this is not a program. Give the folder that the compiler wrote."
    )
