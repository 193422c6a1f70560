"""Which code measured something: figures are comparable only where it is the same."""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import hw_model
from locsnn_compile.errors import InputError

PACKAGE = "locsnn-compile"
_SUFFIXES = (".py", ".yaml")


@cache
def code_version() -> str:
    """Return the package's version and a digest of its sources, which also change between versions."""
    digest = hashlib.sha256()
    for folder in (Path(hw_model.__file__).parent, Path(__file__).parents[1]):
        for path in sorted(folder.rglob("*")):
            if path.suffix in _SUFFIXES:
                content = path.read_bytes()
                digest.update(f"{path.relative_to(folder.parent).as_posix()}\n{len(content)}\n".encode() + content)
    try:
        number = version(PACKAGE)
    except PackageNotFoundError:  # run from its sources
        number = "0"
    return f"{number}+{digest.hexdigest()[:12]}"


def check_code(where: str, code: str) -> None:
    """Refuse what other code than this has measured."""
    if code != code_version():
        raise InputError(
            where,
            "another version of locsnn-compile runs there",
            measured=f"{code} against {code_version()}",
            fix="Install the same one everywhere.",
        )
