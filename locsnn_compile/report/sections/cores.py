"""The section that shows the cores in use at their places on the mesh, how full each is, and its energy."""

import math
from typing import NamedTuple

from locsnn_compile.report.content import Document, Mesh, MeshCore, Section
from locsnn_compile.report.format import count, energy, plural, share
from locsnn_compile.report.sections.verdict import fullness
from locsnn_compile.report.words import core_words, section, words

_CHIPS = 4
"""Most chips that are drawn; a board may have thousands."""
_TILES = 256
"""A chip with more tiles is not drawn."""
_NAMED = 8
"""Cores that the text next to the picture names."""


class _Use(NamedTuple):
    """How far a core is filled, 0..1, the text in it, and its description in words."""

    share: float
    text: str
    words: str


def cores(document: Document) -> Section:
    """Two meshes per chip: every core filled up to its fullest limit, and by its energy."""
    found = document["resources"]
    mesh = found["mesh"]
    energies = {row["core"]: 0.0 for row in found["by_core"]}
    energies |= {row["core"]: row["pj"] for row in document["energy"]["by_core_pj"]}
    by_chip: dict[int, list[Document]] = {}
    for row in found["by_core"]:
        by_chip.setdefault(row["tile"][0] // mesh["columns"], []).append(row)
    drawn = sorted(by_chip.items())[:_CHIPS] if mesh["columns"] * mesh["rows"] <= _TILES else []
    meshes = [pair for its in drawn for pair in (_room(document, *its), _energy(document, *its, energies))]
    left_out = len(by_chip) - len(drawn)
    note = f"{plural(left_out, 'chip is', 'chips are')} not drawn; see core by core."
    return section("cores", *meshes, note if left_out else None)


def _room(document: Document, chip: int, rows: list[Document]) -> Mesh:
    limits = document["resources"]["limits"]
    fullest = {row["core"]: _fullest(limits, row) for row in rows}
    of = f"chip {chip} of {document['target']}" if document["resources"]["mesh"]["chips"] > 1 else document["target"]
    every = plural(document["resources"]["mesh"]["cores_per_chip"], "core")
    title = f"Room used on {of}, in percent: {count(len(rows))} of {every} in use"
    uses = {
        core: _Use(full, f"{100 * full:.0f}", f"{share(full)} of its {limit}")
        for core, (full, limit) in fullest.items()
    }
    return _mesh(document, chip, rows, title, uses)


def _energy(document: Document, chip: int, rows: list[Document], energies: dict[int, float]) -> Mesh:
    most, total = max(energies.values(), default=0.0) or 1.0, sum(energies.values()) or 1.0
    title = f"Energy, in percent of all cores, profile {document['energy']['profile']}"
    uses = {}
    for core, pj in energies.items():
        percent = 100 * pj / total
        text = f"{percent:.{int(percent < 9.95)}f}"
        uses[core] = _Use(pj / most, text, f"{energy(pj)}, {share(pj / total)} of all")
    return _mesh(document, chip, rows, title, uses)


def _mesh(document: Document, chip: int, rows: list[Document], title: str, uses: dict[int, _Use]) -> Mesh:
    """Draw cores by their use, and name those with the most."""
    mesh = document["resources"]["mesh"]
    tile_columns = math.isqrt(mesh["cores_per_tile"] - 1) + 1
    tile_rows = -(-mesh["cores_per_tile"] // tile_columns)
    cores = []
    for row in rows:
        inside_row, inside_column = divmod(row["slot"] % mesh["cores_per_chip"] % mesh["cores_per_tile"], tile_columns)
        column, tile_row = row["tile"][0] - chip * mesh["columns"], row["tile"][1]
        place = column * tile_columns + inside_column, tile_row * tile_rows + inside_row
        cores.append(MeshCore(*place, *uses[row["core"]][:2]))
    named = sorted(rows, key=lambda row: -uses[row["core"]].share)[:_NAMED]
    said = "; ".join(f"{core_words(row)}: {uses[row['core']].words}" for row in named)
    more = f"; and {count(len(rows) - _NAMED)} more" if len(rows) > _NAMED else ""
    return Mesh(title, said + more, mesh["columns"], mesh["rows"], tile_columns, tile_rows, tuple(cores))


def _fullest(limits: Document, row: Document) -> tuple[float, str]:
    """Return how full the fullest limit of a core is, and its name in words."""
    use = [(fullness(entry | {"used": row[name]}), name) for name, entry in limits.items() if name in row]
    full, name = max(use, key=lambda one: one[0])
    return full, words(name)
