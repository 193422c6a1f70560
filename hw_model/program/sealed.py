"""The two files of a program: a readable ``program.yaml``, and its arrays in ``program.npz``.

Programs for all chips are saved this way. ``program.yaml`` holds a checksum of ``program.npz``, so that files of two
programs are not mixed up, and ends with a *seal*: a comment line with the checksum of everything above it. Nothing in
the files is executed.
"""

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hw_model.errors import InputError, check_same
from hw_model.io.files import npy_bytes, pack_files, read_bytes
from hw_model.io.folders import finish_writing, replace_entries
from hw_model.io.npy import load_npy
from hw_model.io.yaml_text import FAST_LOADER, load_yaml
from hw_model.io.zip_directory import BoundedZip
from hw_model.values import AnyArray, Frozen, IntArray, sealed

CHIP_PROGRAM = "locsnn-program"
XYLO_PROGRAM = "locsnn-xylo-program"
SPINNAKER_PROGRAM = "locsnn-spinnaker-program"
KINDS = (CHIP_PROGRAM, XYLO_PROGRAM, SPINNAKER_PROGRAM)
"""The kinds of programs, by the ``format`` that their files say."""
PROGRAM_YAML = "program.yaml"
PROGRAM_NPZ = "program.npz"
SEAL = "# SHA-256 of all above: "
"""The beginning of the last line of ``program.yaml``, which goes on with the checksum."""
# The following limits protect against files that are made to use up memory. They are chosen by hand, far above the
# programs of real boards.
MAX_FILE_BYTES = 2 << 30
MAX_ARRAY_BYTES = 3 << 29
MAX_PACKING = 64
"""All arrays together may unpack to MAX_ARRAY_BYTES, or to this multiple of the file's size if that is more."""
MAX_YAML_NODES = 2_000_000
"""The most values, keys and containers in ``program.yaml``, which has about a hundred per core."""
_NO_PROGRAM = "Give the folder that the compiler wrote."


def sealed_files(
    kind: str, version: int, entries: Mapping[str, Any], arrays: Mapping[str, AnyArray]
) -> dict[str, bytes]:
    """Return both files as bytes, by name; equal entries and integers give the same bytes.

    ``program.yaml`` has the entries in the order of the mapping.
    """
    columns = ((f"{name}.npy", npy_bytes(array.astype(np.int64))) for name, array in arrays.items())
    packed = pack_files(columns, compressed=True)
    document = {
        "format": kind,
        "version": version,
        "arrays_sha256": hashlib.sha256(packed).hexdigest(),
        **entries,
    }
    text = yaml.dump(document, sort_keys=False, allow_unicode=True, width=120, Dumper=_Dumper)
    text += f"{SEAL}{hashlib.sha256(text.encode()).hexdigest()}\n"
    return {PROGRAM_NPZ: packed, PROGRAM_YAML: text.encode()}


def save_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write both files, or neither; everything else in the folder stays."""
    try:
        replace_entries(folder, files)
    except OSError as error:
        what = f"cannot be written: {error.strerror}"
        fix = "Choose a folder that you may write to."
        raise InputError(f"folder {folder.name!r}", what, fix=fix) from error


class _Dumper(yaml.SafeDumper):
    """A dumper that writes texts of several lines, such as the text of a chip file, as readable blocks."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    """Choose how a text is written: plain, as a block of lines, or quoted."""
    # A lone surrogate has no UTF-8 encoding, so it is written as an escape.
    text = text.encode(errors="backslashreplace").decode()
    style = None
    if {*"\x85\u2028\u2029"} & {*text}:
        # YAML readers take these characters for line ends, unless they are escaped in a quoted text.
        style = '"'
    elif "\n" in text:
        style = "|"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


class SealedPair(Frozen, eq=False):
    """The two files as read: the entries of ``program.yaml``, and the bytes of both."""

    document: Mapping[str, Any]
    yaml_bytes: bytes
    npz_bytes: bytes

    @property
    def kind(self) -> object:
        """The kind of program that the file claims to hold; a damaged file may claim anything."""
        return self.document.get("format")

    def check_format(self, kind: str, version: int) -> None:
        """Raise InputError for another kind of program, or another version of its format."""
        if self.kind != kind and self.kind in KINDS:
            what = "this is a program of another kind"
            measured = f"{self.kind} against {kind}"
            fix = "Play it with `locsnn run`."
            raise InputError(PROGRAM_YAML, what, measured=measured, fix=fix)
        if self.kind != kind:
            raise InputError(PROGRAM_YAML, "this is not a program", fix=_NO_PROGRAM)
        what = "the program has another format version"
        fix = "Compile it again, or use the release that wrote it."
        version_of_file = repr(self.document.get("version"))
        check_same(version_of_file, repr(version), PROGRAM_YAML, what, fix=fix)

    def check_arrays(self) -> None:
        """Raise InputError unless ``program.npz`` is the file that ``program.yaml`` was written with."""
        if hashlib.sha256(self.npz_bytes).hexdigest() != self.document.get("arrays_sha256"):
            what = "the checksum differs: it is damaged, or of another program"
            raise InputError(PROGRAM_NPZ, what, fix="Compile again.")

    def check_seal(self) -> None:
        """Raise InputError if ``program.yaml`` was edited. A file without the seal, its last line, is accepted."""
        # Some tools change line ends when they copy text files.
        plain = self.yaml_bytes.replace(b"\r\n", b"\n")
        above, seal, digest = plain.rpartition(SEAL.encode())
        if seal and hashlib.sha256(above).hexdigest().encode() != digest.strip():
            what = "its checksum differs: it was edited, or is damaged"
            fix = "Compile again or, to play it as edited, remove its last line."
            raise InputError(PROGRAM_YAML, what, fix=fix)

    def unpack(self) -> dict[str, IntArray]:
        """Return the int64 arrays by name, read-only.

        A damaged file can raise any exception; callers use :func:`hw_model.io.files.parsing`.
        """
        arrays: dict[str, IntArray] = {}
        content = io.BytesIO(self.npz_bytes)
        with BoundedZip(content, PROGRAM_NPZ, "Compile again.") as archive:
            largest_bytes = max(MAX_ARRAY_BYTES, MAX_PACKING * len(self.npz_bytes))
            if archive.unpacked_bytes > largest_bytes:
                what = "its arrays are absurdly large"
                raise InputError(PROGRAM_NPZ, what, fix="Compile again.")
            for name in archive.namelist():
                array = load_npy(archive.content(name), f"{PROGRAM_NPZ}, {name!r}")
                if array.dtype != np.int64:
                    raise ValueError(name)
                arrays[name.removesuffix(".npy")] = sealed(array)
        return arrays


def read_pair(folder: Path) -> SealedPair:
    """Read both files of a program of any kind; raise ``InputError`` if one is missing or damaged."""
    # A writer that was interrupted may have left one file replaced and the other not.
    finish_writing(folder)
    yaml_bytes, npz_bytes = (
        read_bytes(
            folder / name,
            where=f"program {str(folder)!r}, {name}",
            most=MAX_FILE_BYTES,
            fix="Compile again.",
            missing=_NO_PROGRAM,
        )
        for name in (PROGRAM_YAML, PROGRAM_NPZ)
    )
    document = load_yaml(
        yaml_bytes,
        where=PROGRAM_YAML,
        fault="the file is not YAML: it is damaged",
        fix="Compile again.",
        loader=FAST_LOADER,
        most_nodes=MAX_YAML_NODES,
    )
    if not isinstance(document, dict):
        raise InputError(PROGRAM_YAML, "this is not a program", fix=_NO_PROGRAM)
    return SealedPair(document, yaml_bytes, npz_bytes)
