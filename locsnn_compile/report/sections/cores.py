"""The section that shows the cores in use at their places on the mesh, how full each is, and its energy."""

import math

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
_Use = tuple[float, str, str]
"""How far a core is filled, 0..1, the text in it, and its description in words."""


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
    meshes = [
        pair for its in drawn for pair in (_room(document, *its), _energy(document, *its, energies))
    ]
    left_out = len(by_chip) - len(drawn)
    note = f"{plural(left_out, 'chip is', 'chips are')} not drawn; see core by core."
    return section("cores", *meshes, note if left_out else None)


def _room(document: Document, chip: int, rows: list[Document]) -> Mesh:
    found = document["resources"]
    of = (
        f"chip {chip} of {document['target']}" if found["mesh"]["chips"] > 1 else document["target"]
    )
    every = plural(found["mesh"]["cores_per_chip"], "core")
    uses = []
    for row in rows:
        full, limit = _fullest(found["limits"], row)
        uses.append((full, f"{100 * full:.0f}", f"{share(full)} of its {limit}"))
    return _mesh(
        document,
        chip,
        rows,
        uses,
        f"Fullest limit of each core of {of}, in percent: {count(len(rows))} of {every} in use",
    )


def _energy(
    document: Document, chip: int, rows: list[Document], energies: dict[int, float]
) -> Mesh:
    most, total = max(energies.values(), default=0.0) or 1.0, sum(energies.values()) or 1.0
    uses = []
    for pj in (energies[row["core"]] for row in rows):
        percent = 100 * pj / total
        uses.append(
            (
                pj / most,
                f"{percent:.{int(percent < 9.95)}f}",
                f"{energy(pj)}, {share(pj / total)} of all",
            )
        )
    title = f"Energy, in percent of all cores, profile {document['energy']['profile']}"
    return _mesh(document, chip, rows, uses, title)


def _mesh(
    document: Document, chip: int, rows: list[Document], uses: list[_Use], title: str
) -> Mesh:
    """Draw cores by their use, and name those with the most."""
    mesh = document["resources"]["mesh"]
    tile_columns = math.isqrt(mesh["cores_per_tile"] - 1) + 1
    tile_rows = -(-mesh["cores_per_tile"] // tile_columns)
    cores = []
    for row, (full, text, _) in zip(rows, uses, strict=True):
        inside_row, inside_column = divmod(
            row["slot"] % mesh["cores_per_chip"] % mesh["cores_per_tile"], tile_columns
        )
        column, tile_row = row["tile"][0] - chip * mesh["columns"], row["tile"][1]
        place = column * tile_columns + inside_column, tile_row * tile_rows + inside_row
        cores.append(MeshCore(*place, full, text))
    named = sorted(zip(rows, uses, strict=True), key=lambda core: -core[1][0])[:_NAMED]
    said = "; ".join(f"{core_words(row)}: {words}" for row, (_, _, words) in named)
    more = f"; and {count(len(rows) - _NAMED)} more" if len(rows) > _NAMED else ""
    return Mesh(
        title, said + more, mesh["columns"], mesh["rows"], tile_columns, tile_rows, tuple(cores)
    )


def _fullest(limits: Document, row: Document) -> tuple[float, str]:
    """Return how full the fullest limit of a core is, and its name in words."""
    use = [
        (fullness(entry | {"used": row[name]}), name)
        for name, entry in limits.items()
        if name in row
    ]
    full, name = max(use, key=lambda one: one[0])
    return full, words(name)
