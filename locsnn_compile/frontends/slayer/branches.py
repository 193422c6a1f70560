"""The layers of each branch, as the option ``--branches`` or the key ``branches`` of the YAML names them."""

from collections.abc import Mapping, Sequence
from typing import Any

from hw_model.mapping.graph import AXES
from locsnn_compile.errors import InputError, check_known

JOINED = "joined"
"""The branch of layers that run over the outputs of all others, one after the other."""
BRANCHES = (*AXES, JOINED)

Branches = Mapping[str, tuple[str, ...]]
"""The layers of each branch, in the order in which they run."""

_FORM = "Give them as time=fc1,fc2,location=locationFc1,locationFc2."


def parse_branches(text: str) -> Branches:
    """Read ``time=fc1,fc2,location=locationFc1,locationFc2``: a name with ``=`` begins a branch."""
    where = f"branches {text[:80]!r}"
    branches: dict[str, tuple[str, ...]] = {}
    branch = None
    for item in text.split(","):
        before, separator, name = item.strip().rpartition("=")
        if separator:
            branch = before.strip()
            if branch in branches:
                raise InputError(where, f"branch {branch!r} is given twice", fix="Give it once.")
            branches[branch] = ()
        if branch is None or not name.strip():
            raise InputError(where, "they are not layers of branches", fix=_FORM)
        branches[branch] += (name.strip(),)
    return checked_branches(branches, where)


def checked_branches(branches: Mapping[Any, Sequence[Any]], where: str) -> Branches:
    """Return branches and their layers; refuse those of another name, or without layers."""
    for branch, layers in branches.items():
        check_known(where, f"branch {str(branch)[:40]!r} is not known", branch, BRANCHES)
        listed = isinstance(layers, list | tuple) and len(layers) > 0
        if not listed or not all(isinstance(name, str) for name in layers):
            raise InputError(where, f"branch {branch!r} has no list of layers", fix=_FORM)
    if not any(axis in branches for axis in AXES):
        raise InputError(where, "no branch runs along time or location", fix=_FORM)
    return {branch: tuple(layers) for branch, layers in branches.items()}
