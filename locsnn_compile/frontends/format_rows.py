"""The types of the table in :mod:`locsnn_compile.frontends.formats`, and of the arguments of its readers.

They are plain dataclasses that import nothing heavy, because help shows the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from locsnn_compile.models.checkpoint import Checkpoint
    from locsnn_compile.network.network import Network


@dataclass(frozen=True)
class LoadOptions:
    """The keyword arguments of :func:`locsnn_compile.load`; None means that an option is not given."""

    config: str | Path | None = None
    dt: float | None = None
    reset: str | None = None
    discretisation: str | None = None
    floor: float | None = None
    kernels: str | None = None
    branches: str | Mapping[str, Sequence[str]] | None = None
    channel_order: str | None = None
    relay_delays: bool | None = None
    host_layers: str | None = None

    @classmethod
    def of(cls, values: object) -> "LoadOptions":
        """Return the options that an object has as attributes, such as the arguments of a command."""
        return cls(**{field.name: getattr(values, field.name) for field in fields(cls)})

    @property
    def given(self) -> dict[str, Any]:
        """The options that are given, by name; a switch that is off counts as not given."""
        return {
            name: value
            for name, value in vars(self).items()
            if value is not None and value is not False
        }


@dataclass(frozen=True)
class FormatOption:
    """An option that only some formats take, as the command line declares it.

    - ``name``: its keyword in :class:`LoadOptions`
    - ``value``: the word for its value in help; empty for a switch
    - ``is_number``: whether the value is a number
    - ``elsewhere``: why other formats do not take it, for an error; ``{called}`` is the other format
    """

    name: str
    help: str
    value: str = ""
    is_number: bool = False
    elsewhere: str = "{called} contains this itself"


@dataclass(frozen=True)
class ModelSource:
    """A model to read: a file, or a checkpoint that is in memory."""

    path: Path
    options: LoadOptions
    checkpoint: "Checkpoint | None" = None

    @property
    def where(self) -> str:
        """How errors name it."""
        if self.checkpoint is not None:
            return f"model {self.checkpoint.description.name!r}"
        return f"model {self.path.name!r}"

    @cached_property
    def hdf5_entries(self) -> tuple[str, ...]:
        """The names at the root of an HDF5 file; raise ``InputError`` if the file is not HDF5."""
        from locsnn_compile.data.hdf5.read import open_hdf5

        with open_hdf5(self.path, self.where) as (root, _):
            return tuple(root.names())


class Recogniser(Protocol):
    """Distinguishes the files of a format from others with the same ending."""

    def __call__(self, source: ModelSource, /) -> bool:
        """Return whether a file has the format; raise ``InputError`` for a file that cannot be read."""


class Reader(Protocol):
    """Reads the files of a format."""

    def __call__(self, source: ModelSource, /) -> "Network":
        """Return the network; raise ``InputError`` for a file that cannot be read or used."""


@dataclass(frozen=True)
class ModelFormat:
    """A format of model files.

    - ``called``: what errors call a file of this format, such as "a NIR graph"
    - ``helped``: its words in the list of ``--help``; empty if the words of another row include it
    - ``offered``: its words in the advice of errors; empty for a format that needs more than one file
    - ``suffixes``: the endings of its files
    - ``recognises``: distinguishes its files from those of other formats with the same ending
    - ``read``: reads a file and returns the network
    - ``options``: the names of the options in ``FORMAT_OPTIONS`` that it takes
    """

    called: str
    helped: str
    offered: str
    suffixes: tuple[str, ...]
    recognises: Recogniser
    read: Reader
    options: tuple[str, ...] = ()
