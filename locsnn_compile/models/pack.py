"""Several checkpoints in one file, ``locsnn-committee``, a plain dict in torch's own file format.

    {"format", "version", "members": {"1": {"sha256", "weight", "checkpoint": as in a checkpoint of its own}, "2": ...}}

Only the first member that carries recordings keeps them. Nothing of the file is ever run.
"""

import re
from dataclasses import replace
from pathlib import Path

from hw_model.io.files import replace_file
from hw_model.values import Shown
from locsnn_compile.data.torch_writer import torch_bytes
from locsnn_compile.models.checkpoint import Checkpoint, checkpoint_values
from locsnn_compile.models.checkpoint_reader import check_keys, parse_checkpoint, read_plain
from locsnn_compile.models.plain_checks import WRITE_AGAIN, file_fault

FORMAT, VERSION = "locsnn-committee", 1
_MEMBER: dict[str, tuple[type, ...]] = {"sha256": (str,), "weight": (float,), "checkpoint": (dict,)}


class Pack(Shown):
    """Checkpoints whose class scores are added, each by its weight; ``sha256`` of the file."""

    members: tuple[Checkpoint, ...]
    weights: tuple[float, ...]
    sha256: str = ""

    def save(self, path: Path | str) -> None:
        """Write it to a file, whole or not at all."""
        carrying = next((member for member in self.members if member.recordings is not None), None)
        members = {
            str(number): {
                "sha256": member.sha256,
                "weight": float(weight),
                "checkpoint": checkpoint_values(member if member is carrying else replace(member, recordings=None)),
            }
            for number, (member, weight) in enumerate(zip(self.members, self.weights, strict=True), start=1)
        }
        where = f"committee {Path(path).name!r}"
        content = torch_bytes({"format": FORMAT, "version": VERSION, "members": members}, where)
        replace_file(Path(path), content, where)


def read_models(path: Path | str, *, state_dict: str = WRITE_AGAIN) -> Checkpoint | Pack:
    """Return the checkpoint at ``path``, or the pack of several; ``InputError`` for anything else."""
    values, where, sha256 = read_plain(Path(path), state_dict)
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        return parse_checkpoint(values, where, Path(path).name, sha256)
    if values.get("version") != VERSION:
        raise file_fault(where, "its version does not exist", f"version {values.get('version')} against {VERSION}")
    check_keys(where, "", values, {"format": (str,), "version": (int,), "members": (dict,)})
    check_keys(where, "members.", values["members"], dict.fromkeys(values["members"], (dict,)))
    members, weights = [], []
    for number, entry in values["members"].items():
        place = f"{where}, member {str(number)[:20]!r}"
        check_keys(place, "", entry, _MEMBER)
        if not re.fullmatch("[0-9a-f]{64}|", entry["sha256"]):
            raise file_fault(place, "its sha256 is not one")
        members.append(parse_checkpoint(entry["checkpoint"], place, Path(path).name, entry["sha256"]))
        weights.append(entry["weight"])
    if not members:
        raise file_fault(where, "it has no members")
    return Pack(tuple(members), tuple(weights), sha256)
