"""Parse the layers of each branch, which the option ``--branches`` or the key ``branches`` of the YAML names."""

from collections.abc import Mapping, Sequence
from typing import Any

from hw_model.mapping.graph import AXES
from locsnn_compile.errors import InputError, check_known

JOINED = "joined"
"""The name of a branch of layers that run over the outputs of all other branches; the chip cannot run it."""
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
        branch_name, separator, name = item.strip().rpartition("=")
        if separator:
            branch = branch_name.strip()
            if branch in branches:
                raise InputError(where, f"branch {branch!r} is given twice", fix="Give it once.")
            branches[branch] = ()
        if branch is None or not name.strip():
            raise InputError(where, "they are not layers of branches", fix=_FORM)
        branches[branch] += (name.strip(),)
    return checked_branches(branches, where)


def checked_branches(branches: Mapping[Any, Sequence[Any]], where: str) -> Branches:
    """Return branches and their layers; raise ``InputError`` for unknown branches, and for branches without layers."""
    for branch, layers in branches.items():
        check_known(where, f"branch {str(branch)[:40]!r} is not known", branch, BRANCHES)
        is_filled_list = isinstance(layers, list | tuple) and len(layers) > 0
        if not is_filled_list or not all(isinstance(name, str) for name in layers):
            raise InputError(where, f"branch {branch!r} has no list of layers", fix=_FORM)
    if not any(axis in branches for axis in AXES):
        raise InputError(where, "no branch runs along time or location", fix=_FORM)
    return {branch: tuple(layers) for branch, layers in branches.items()}
