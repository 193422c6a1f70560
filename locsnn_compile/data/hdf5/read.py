"""Read untrusted HDF5 files: networks and recordings from strangers.

Sizes are checked before data are read, and links are never followed. The C library may crash on a
damaged file, which Python cannot catch, so a separate process (:mod:`.probe`), started once, reads
each file first; a file on which it crashes is refused. Readers get a :class:`Group`, whose every fault
is an ``InputError`` that names the place.
"""

import atexit
import hashlib
import io
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hw_model.io.files import parsing, read_bytes
from hw_model.io.processor_time import processor_seconds, too_little_time
from hw_model.values import AnyArray, FloatArray, sealed
from locsnn_compile.errors import InputError, check_most, check_same

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

MAX_BYTES = 500_000_000
"""Largest size of all datasets of a file together, unpacked."""
MAX_ROWS = 100_000
"""Largest number of rows of different lengths."""
MAX_TEXT = 1000
"""Longest text, in characters."""
MAX_INTEGER = 2**62
"""Largest integer, far enough below the end of int64 that small sums of it do not wrap."""

_NUMBERS = "biuf"
"""Kinds of numpy's types of numbers: truth values, signed and unsigned integers, floats."""
_TEXTS = "OS"
"""Kinds of numpy's types in which HDF5 gives texts: objects of any length, and bytes of a fixed one."""
_WHOLE = "Give a whole file, or write it again."
"""The way out for a damaged file, in errors."""
_PROBE = Path(__file__).with_name("probe.py")

_SURVIVED = b"\1"
"""The probe's answer if the library can read a file; see :mod:`.probe`."""
_OUT_OF_TIME = b"\2"
"""The probe's answer if the processor time that it inherited did not suffice."""

answers: dict[bytes, bytes] = {}
"""The probe's answers so far, by the hashes of the files: loading a network opens a file more than once."""
_lock = threading.Lock()
"""Held during a request: two threads must not mix theirs on the one connection."""


@cache
def start_prober(owner: int) -> "Connection":
    """Start the probe, and return the connection to it; further calls return the same connection.

    ``owner`` is the id of the calling process. It only tells calls apart: a forked process, which must
    not share its parent's connection, has another id and so starts a probe of its own.
    """
    from multiprocessing.connection import Pipe

    ours, theirs = Pipe()
    # The probe must find h5py where this process finds it. It runs with -P so that it does not look
    # in its own folder, whose modules have general names.
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-P", str(_PROBE), str(theirs.fileno())]
    process = subprocess.Popen(
        command, stderr=subprocess.DEVNULL, env=environment, pass_fds=[theirs.fileno()]
    )
    theirs.close()
    # Exit handlers are called last first: the connection is closed, which ends the probe, and then
    # the probe is waited for.
    atexit.register(process.wait)
    atexit.register(ours.close)
    return ours


def library_survives(data: bytes) -> bool:
    """Return whether the library can read these bytes as HDF5 without crashing.

    The library crashes, or runs for ever, on some damaged files. Neither can be caught in the reading
    process. If the probe cannot be started, the answer is True, so that files can be read anyway.
    Raises ``InputError`` if the processor time that this process inherited is too little to find out.
    """
    if sys.platform == "win32":
        return True  # The probe needs fork and resource limits, which Windows does not have.
    digest = hashlib.sha256(data).digest()
    try:
        with _lock:
            if digest not in answers:
                prober = start_prober(os.getpid())
                prober.send_bytes(data)
                answers[digest] = prober.recv_bytes()
            answer = answers[digest]
    except (OSError, EOFError):
        # The probe itself is gone: the next file starts another.
        start_prober.cache_clear()
        return True
    seconds = processor_seconds()
    if answer == _OUT_OF_TIME and seconds is not None:
        raise too_little_time(seconds)
    return answer == _SURVIVED


class Group:
    """A group of an HDF5 file; every fault inside is an ``InputError`` that names the place."""

    def __init__(self, group: Any, where: str, budget: "_Budget") -> None:
        self._group, self.where, self._budget = group, where, budget

    def names(self) -> list[str]:
        """Return the names of the groups and datasets in it, in file order."""
        return [str(name) for name in self._group]

    def __contains__(self, name: str) -> bool:
        return name in self.names()

    def group(self, name: str, where: str | None = None) -> "Group":
        """Return the group ``name`` inside this one; errors call it ``where``."""
        member = self._member(name)
        if not _is_group(member):
            raise InputError(self.where, f"{name!r} is a value, not a group", fix=_WHOLE)
        return Group(member, where or self.where, self._budget)

    def array(self, name: str, *, infinite: bool = False) -> AnyArray:
        """Return a dataset of numbers, read-only, as int64 or float64; ``infinite`` numbers only if allowed."""
        dataset = self._dataset(name)
        if dataset.dtype.kind not in _NUMBERS:
            raise InputError(
                self.where,
                f"{name!r} is not made of numbers",
                measured=f"{dataset.dtype}",
                fix=_WHOLE,
            )
        values = np.asarray(self._read(dataset, name))
        if values.dtype.kind == "f":
            values = values.astype(np.float64)
            if np.isnan(values).any() or (not infinite and np.isinf(values).any()):
                fix = "Train or export again."
                raise InputError(self.where, f"{name!r} holds a number that is not finite", fix=fix)
        else:
            check_most(
                int(values.max(initial=0)),
                MAX_INTEGER,
                self.where,
                f"{name!r} is too large",
                fix=_WHOLE,
            )
            values = values.astype(np.int64)
        return sealed(values)

    def records(self, name: str, fields: Sequence[str]) -> AnyArray:
        """Return a dataset of records, (rows,), of these fields of numbers."""
        dataset = self._dataset(name)
        names = dataset.dtype.names or ()
        if dataset.ndim != 1 or not {*fields} <= {*names}:
            what = f"{name!r} does not hold records of {', '.join(fields)}"
            raise InputError(self.where, what, measured=f"{dataset.dtype}"[:80], fix=_WHOLE)
        records = np.asarray(self._read(dataset, name))
        return sealed(records[list(fields)].copy())

    def holds_numbers(self, name: str) -> bool:
        """Tell whether a dataset is made of numbers, without reading it."""
        member = self._member(name)
        return getattr(member, "shape", None) is not None and member.dtype.kind in _NUMBERS

    def rows(self, name: str) -> list[FloatArray]:
        """Return a dataset whose rows of numbers differ in length."""
        import h5py

        dataset = self._dataset(name)
        kind = h5py.check_vlen_dtype(dataset.dtype)
        if kind is None or kind.kind not in _NUMBERS or dataset.ndim != 1:
            raise InputError(self.where, f"{name!r} does not hold rows of numbers", fix=_WHOLE)
        check_most(
            len(dataset),
            MAX_ROWS,
            self.where,
            f"{name!r} has too many rows",
            fix="Give fewer recordings.",
        )
        rows = []
        for index in range(len(dataset)):
            # The library returns the bytes as they are in the file, but calls them native.
            row = dataset[index].view(kind).astype(np.float64)
            self._budget.take(row.nbytes, f"{self.where}: {name!r}")
            rows.append(row)
        return rows

    def value(self, name: str) -> AnyArray | str:
        """Return a dataset of one text or of numbers."""
        return self.text(name) if self._dataset(name).dtype.kind in _TEXTS else self.array(name)

    def text(self, name: str) -> str:
        """Return a dataset of exactly one text."""
        texts = self.texts(name)
        check_same(len(texts), 1, self.where, f"{name!r} must be one text", fix=_WHOLE)
        return texts[0]

    def is_group(self, name: str) -> bool:
        """Tell whether there is a group of this name."""
        return _is_group(self._member(name))

    def texts(self, name: str) -> list[str]:
        """Return a dataset of texts, row by row."""
        dataset = self._dataset(name)
        if dataset.dtype.kind not in _TEXTS:
            raise InputError(
                self.where, f"{name!r} is not text", measured=f"{dataset.dtype}", fix=_WHOLE
            )
        texts = []
        for value in np.asarray(self._read(dataset, name), dtype=object).reshape(-1):
            text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
            if not isinstance(text, str) or len(text) > MAX_TEXT:
                raise InputError(
                    self.where, f"{name!r} is not text of {MAX_TEXT} characters at most", fix=_WHOLE
                )
            texts.append(text)
        return texts

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a dataset, without reading it."""
        return tuple(int(n) for n in self._dataset(name).shape)

    def _member(self, name: str) -> Any:
        """Return a group or a dataset of h5py; refuse one that is missing, or a link to another place."""
        import h5py

        link = self._group.get(name, getlink=True)
        if link is None:
            raise InputError(self.where, f"{name!r} is missing", fix=_WHOLE)
        if not isinstance(link, h5py.HardLink):
            fix = "Store the data itself."
            raise InputError(self.where, f"{name!r} is a link, and links are not followed", fix=fix)
        return self._group[name]

    def _dataset(self, name: str) -> Any:
        """Return a dataset of h5py; refuse groups, datasets without values, and those that lie in another file."""
        member = self._member(name)
        if _is_group(member) or not hasattr(member, "dtype"):
            raise InputError(self.where, f"{name!r} is a group, not a value", fix=_WHOLE)
        if member.shape is None:
            raise InputError(self.where, f"{name!r} is empty", fix=_WHOLE)
        if member.is_virtual or member.external:
            raise InputError(
                self.where, f"{name!r} keeps its data in another file", fix="Store the data itself."
            )
        self._check_filters(member, name)
        return member

    def _check_filters(self, dataset: Any, name: str) -> None:
        """Refuse a dataset that is compressed in a way that this library lacks the code for."""
        import h5py

        creation = dataset.id.get_create_plist()
        for index in range(creation.get_nfilters()):
            code, _, _, filter_name = creation.get_filter(index)
            if not h5py.h5z.filter_avail(code):
                what = f"{name!r} is compressed by a filter that HDF5 does not have here"
                measured = f"number {code}, {filter_name.decode('utf-8', 'replace')[:40]!r}"
                fix = "Store it with gzip, or uncompressed."
                raise InputError(self.where, what, measured=measured, fix=fix)

    def _read(self, dataset: Any, name: str) -> Any:
        """Return the values of a dataset of h5py; refuse it, unread, if the file would unpack to too much."""
        # Numbers become int64 or float64, so each takes 8 bytes or more.
        unpacked_bytes = int(dataset.size) * max(8, dataset.dtype.itemsize)
        self._budget.take(unpacked_bytes, f"{self.where}: {name!r}")
        return dataset[()]


def _is_group(member: Any) -> bool:
    return hasattr(member, "keys")


class _Budget:
    """The number of bytes that were read so far from one file; all of its groups share it."""

    taken = 0

    def take(self, amount: int, where: str) -> None:
        self.taken += amount
        what, fix = "the file unpacks to more than is read", "Give a smaller file."
        check_most(self.taken, MAX_BYTES, where, what, unit="bytes", fix=fix)


@contextmanager
def open_hdf5(path: Path, where: str) -> Iterator[tuple[Group, bytes]]:
    """Open a file: yield its root group and its bytes. Any exception of h5py becomes an ``InputError``."""
    data = read_bytes(path, where)
    with open_hdf5_bytes(data, where) as root:
        yield root, data


@contextmanager
def open_hdf5_bytes(data: bytes, where: str) -> Iterator[Group]:
    """Open the bytes of a file: yield its root group. Any exception of h5py becomes an ``InputError``."""
    import h5py

    what = "it is damaged, truncated or not an HDF5 file"
    if not library_survives(data):
        raise InputError(where, what, fix=_WHOLE)
    with parsing(where, what, fix=_WHOLE), h5py.File(io.BytesIO(data), "r") as file:
        yield Group(file, where, _Budget())
