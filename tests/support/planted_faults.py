"""Faults that tests plant in the SystemVerilog, to see that a bench or a proof finds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A fault by its name: in a file, what to write in place of a text that occurs there once."""

    name: str
    file: str
    old: str
    new: str

    @classmethod
    def of_row(cls, row: Mapping[str, str]) -> Fault:
        """Return the fault of a row of `mutants.yaml` or `proofs.yaml`."""
        return cls(row["id"], row["file"], row["old"], row["new"])

    def fits(self, texts: Mapping[str, str]) -> bool:
        """Return whether the old text occurs once, and differs from the new one."""
        return texts[self.file].count(self.old) == 1 and self.old != self.new

    def planted_in(self, texts: Mapping[str, str]) -> dict[str, str]:
        """Return the files by name, with the fault."""
        assert self.fits(texts), self.name
        return {**texts, self.file: texts[self.file].replace(self.old, self.new)}
