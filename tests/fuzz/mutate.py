"""Damage bytes: anywhere, in sizes, in words of text, and inside zip archives and HDF5 files that stay whole around it.

``mutated(data, kind, chance)`` gives the same bytes for the same random state, always.
"""

import io
import random
import struct
import zipfile

import h5py
import numpy as np

# Numbers at which widths of integers end: as sizes in a file they say too much or too little.
SIZES = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0xFFFFFFFF,
    2**40,
    2**63 - 1,
    2**64 - 1,
)
# Words of text are replaced by these. The order matters: it decides the damage of a case.
WORDS = (
    # Numbers of every kind, and values of other types.
    *(
        "0",
        "-1",
        "1e999",
        ".nan",
        "NaN",
        "-.inf",
        "1.5",
        "99999999999999999999",
        "1e-320",
        "true",
        "null",
        "''",
        "[]",
    ),
    # Containers, and what YAML can do beyond values: aliases, and tags that run code or decode bytes.
    *(
        "{}",
        "[1, 2]",
        "{a: 1}",
        "&a [*a]",
        "*a",
        "!!python/object/apply:os.system ['touch ran']",
        "!!binary aGk=",
        "~",
    ),
    # A path outside of the folder, what moves a terminal's cursor or turns its text around, a lone surrogate, and the
    # marks of YAML.
    *(
        "../../ran",
        "\x1b[31m",
        "\u202e",
        "\ud800",
        "=",
        "<<",
        "2026-01-01",
        "0x10",
        "1_000",
        "|",
        '"',
        "'",
        ":",
        "-",
    ),
    # Nesting and length, blanks and control characters, and numbers that only some readers know.
    *(
        '"\\ud800"',
        "0.5",
        "2",
        "3",
        "4",
        "64",
        "[" * 50,
        "{a: " * 50,
        "a" * 3000,
        "\x00",
        "\t",
        "\r\n",
        "%",
        "\ufeff",
        "1 2 3",
        "nan",
        "-0.0",
        "1:30:00",
    ),
)
# Arrays are replaced by what these make of them: other types, axes, sizes and values.
ARRAYS = (
    lambda a: a.astype(np.float64) * np.nan,
    lambda a: a.astype(np.float64) * 1e300,
    lambda a: a.astype(np.int8),
    lambda a: a.astype(np.complex64),
    lambda a: a.astype("S3"),
    lambda a: a.astype(bool),
    lambda a: a.reshape(-1),
    lambda a: a[..., np.newaxis],
    lambda a: np.zeros((0, 3)),
    lambda a: -np.abs(a.astype(np.float64)),
    lambda a: np.zeros_like(a),
    lambda a: np.resize(a, (3, 5)),
    lambda a: np.array(2**62),
    lambda a: np.full(a.shape, 0.5),
)


def mutated(data, kind, chance):
    """Return ``data`` with a few faults; ``kind``: bytes, text, zip or hdf5."""
    ways = {
        "bytes": (damage,),
        "text": (damage, retype),
        # Twice, so that it is drawn more often: most damage of an archive is refused before its contents are read.
        "zip": (damage, repack, repack),
        "hdf5": (damage, regraph),
    }
    chosen = [chance.choice(ways[kind]) for _ in range(chance.choice((1, 1, 1, 2, 4)))]
    # Faults by libraries that read and write whole files come first, random damage last.
    for way in sorted(chosen, key=lambda way: way is damage):
        data = way(data, chance)
    return data


def damage(data, chance):
    """Flip bits, cut, splice, repeat, or write sizes, at random places."""
    damaged = bytearray(data)
    position, length = (chance.randrange(len(damaged) + 1) for _ in range(2)) if damaged else (0, 0)
    length = min(length, chance.choice((1, 4, 16, 256, length)))
    way = chance.randrange(8)
    if way == 0:
        del damaged[position:]
    elif way == 1:
        del damaged[position : position + length]
    elif way == 2:
        damaged[position:position] = chance.randbytes(length)
    elif way == 3:
        other = chance.randrange(len(damaged) + 1)
        damaged[position : position + length] = damaged[other : other + length]
    elif way == 4 and damaged:
        size = struct.pack(chance.choice("<>") + "Q", chance.choice(SIZES))
        width = chance.choice((1, 2, 4, 8))
        damaged[position : position + width] = (
            size[:width] if chance.random() < 0.5 else size[-width:]
        )
    elif way == 5:
        damaged[position : position + length] = chance.choice((b"\x00", b"\xff", b" ")) * length
    else:
        for _ in range(chance.choice((1, 1, 2, 8, 64)) if damaged else 0):
            damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def retype(data, chance):
    """Replace, repeat or drop a word or a line of a text."""
    lines = data.decode("utf-8", "surrogateescape").split("\n")
    row = chance.randrange(len(lines))
    way = chance.randrange(5)
    if way == 0:
        lines.insert(chance.randrange(len(lines) + 1), lines[row])
    elif way == 1:
        del lines[row]
    elif way == 2:
        lines[row] = chance.choice(("", "  ", "    ")) + lines[row]
    else:
        words = lines[row].split(" ")
        words[chance.randrange(len(words))] = chance.choice(WORDS)
        lines[row] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "surrogatepass" if chance.random() < 0.5 else "replace")


def repack(data, chance):
    """Change a member of an archive, its name or its kind; the archive around it is whole, with new checksums."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(member.filename, archive.read(member)) for member in archive.infolist()]
    except Exception:
        return damage(data, chance)
    at = chance.randrange(len(members)) if members else 0
    way = chance.randrange(8) if members else 8
    name, content = members[at] if members else ("", b"")
    if not members:
        pass
    elif way == 0:
        members.append((name, damage(content, chance)))
    elif way == 1:
        del members[at]
    elif way == 2:
        members[at] = (
            chance.choice(
                ("../../ran", "/ran", "a" * 300, "\x1b[31m.npy", "", name + "/", "x/../" + name)
            ),
            content,
        )
    elif way == 3:
        other = chance.randrange(len(members))
        members[at] = (name, members[other][1])
    elif way == 4 and content[:6] == b"\x93NUMPY":
        members[at] = (name, rearrayed(content, chance))
    elif way == 5:
        members[at] = (name, rehead(content, chance))
    else:
        members[at] = (name, damage(content, chance))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for entry, inside in members:
            member = zipfile.ZipInfo(entry.replace("\x00", ""))
            member.compress_type = chance.choice(
                (zipfile.ZIP_STORED, zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
            )
            member.external_attr = chance.choice((0o644, 0o644, 0o120777)) << 16
            archive.writestr(member, inside)
    return packed.getvalue()


def rehead(content, chance):
    """Damage the first bytes alone: headers say the most."""
    length = min(len(content), 128)
    return damage(content[:length], chance) + content[length:]


def rearrayed(content, chance):
    """Return the bytes of another array."""
    try:
        array = chance.choice(ARRAYS)(np.load(io.BytesIO(content), allow_pickle=False))
        stream = io.BytesIO()
        np.save(stream, array, allow_pickle=False)
        return stream.getvalue()
    except Exception:
        return damage(content, chance)


def regraph(data, chance):
    """Change an HDF5 file by its own library: other types, shapes and links, and items that are missing or twice."""
    stream = io.BytesIO(data)
    try:
        with h5py.File(stream, "a") as file:
            paths = []
            file.visit(paths.append)
            path = chance.choice(paths)
            _change(file, path, chance.choice(paths), chance)
    except Exception:
        return damage(data, chance)
    return stream.getvalue()


def _change(file, path, other, chance):
    """Change the item at a path of an HDF5 file; ``other`` is a path to copy or link from."""
    way = chance.randrange(9)
    item = file[path]
    if way == 0:
        del file[path]
    elif way == 1:
        del file[path]
        file[path] = chance.choice(
            (h5py.SoftLink("/nowhere"), h5py.SoftLink("/"), h5py.ExternalLink("ran", "/"))
        )
    elif way == 2:
        del file[path]
        file.create_group(path)
    elif way == 3:
        file.copy(other, f"{path}_{chance.randrange(9)}")
    elif way == 4:
        file[f"{path}/deep" if isinstance(item, h5py.Group) else f"{path}_again"] = file[other]
    elif way == 5:
        del file[path]
        file[path] = chance.choice(
            (np.nan, "text", b"bytes", 2**63 - 1, -1, 0, [], h5py.Empty("f4"), "é" * 5000)
        )
    elif isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf":
        array = chance.choice(ARRAYS)(np.asarray(item[()]))
        del file[path]
        if chance.random() < 0.2:
            file.create_dataset(path, shape=(2**20, 2**20), chunks=(64, 64), dtype="f4")
        else:
            file[path] = array
    elif isinstance(item, h5py.Dataset):
        texts = np.asarray(item[()], dtype=object).reshape(-1)
        if texts.size:
            words = [
                "",
                "LIF",
                "Linear",
                "NIRGraph",
                "input",
                "output",
                "x" * 2000,
                "a/b",
                "dense",
                "conv",
                "Scale",
                "I",
            ]
            texts[chance.randrange(texts.size)] = chance.choice(
                (*words, texts[chance.randrange(texts.size)])
            )
        shape = item.shape
        del file[path]
        file.create_dataset(path, data=texts.reshape(shape), dtype=h5py.string_dtype())


def case_chance(reader, number):
    """Return the random state of a case: the same for the same reader and number, always."""
    return random.Random(f"{reader} {number}")
