"""The section that shows the cores in use where they sit on the mesh, how full each is and what it takes."""

from __future__ import annotations

import math

from locsnn_compile.report.content import Document, Mesh, MeshCore, Paragraph, Section, section
from locsnn_compile.report.format import count, energy, plural, share
from locsnn_compile.report.sections.verdict import fullness
from locsnn_compile.report.words import core_words, words

_CHIPS = 4
"""Chips that are drawn; a board may have thousands."""
_TILES = 256
"""Tiles of a chip that are drawn at the most."""
_NAMED = 8
"""Cores that the words beside the picture name."""


def cores(document: Document) -> Section:
    """Two meshes a chip, every core filled as far as its fullest limit, and by its share of the energy."""
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
    lead = (
        "Each core where it sits on the mesh, filled from below: as far as the fullest of its limits, and by its "
        "energy beside that of the core that takes most. Empty tiles are free."
    )
    return section("cores", "Use of the cores", lead, *meshes, Paragraph(note) if left_out else None)


def _room(document: Document, chip: int, rows: list[Document]) -> Mesh:
    fullest = {row["core"]: _fullest(document, row) for row in rows}
    named = sorted(rows, key=lambda row: -fullest[row["core"]][1])[:_NAMED]
    said = [_said(row, f"{share(full)} of its {limit}") for row in named for limit, full in [fullest[row["core"]]]]
    of = f"chip {chip} of {document['target']}" if document["resources"]["mesh"]["chips"] > 1 else document["target"]
    title = f"Room on {of}, in percent: {plural(len(rows), 'core')} in use of "
    title += count(document["resources"]["mesh"]["cores_per_chip"])
    use = {core: (full, f"{100 * full:.0f}") for core, (_, full) in fullest.items()}
    return _mesh(document, chip, rows, use, title, said)


def _energy(document: Document, chip: int, rows: list[Document], energies: dict[int, float]) -> Mesh:
    most, total = max(energies.values(), default=0.0) or 1.0, sum(energies.values()) or 1.0
    named = sorted(rows, key=lambda row: -energies[row["core"]])[:_NAMED]
    said = [
        _said(row, f"{energy(energies[row['core']])}, {share(energies[row['core']] / total)} of all") for row in named
    ]
    title = f"Energy, in percent of that of all cores, profile {document['energy']['profile']}"
    percents = {core: 100 * pj / total for core, pj in energies.items()}
    use = {core: (pj / most, f"{percents[core]:.{int(percents[core] < 9.95)}f}") for core, pj in energies.items()}
    return _mesh(document, chip, rows, use, title, said)


def _mesh(
    document: Document,
    chip: int,
    rows: list[Document],
    use: dict[int, tuple[float, str]],
    title: str,
    said: list[str],
) -> Mesh:
    """Draw cores with what ``use[core]`` says: how far it is filled, and the text in it."""
    mesh = document["resources"]["mesh"]
    tile_columns = math.isqrt(mesh["cores_per_tile"] - 1) + 1
    tile_rows = -(-mesh["cores_per_tile"] // tile_columns)
    cores = []
    for row in rows:
        inside_row, inside_column = divmod(row["slot"] % mesh["cores_per_chip"] % mesh["cores_per_tile"], tile_columns)
        column, tile_row = row["tile"][0] - chip * mesh["columns"], row["tile"][1]
        place = column * tile_columns + inside_column, tile_row * tile_rows + inside_row
        cores.append(MeshCore(*place, *use[row["core"]]))
    more = f"; and {count(len(rows) - len(said))} more" if len(rows) > len(said) else ""
    return Mesh(
        title=title,
        description="; ".join(said) + more,
        columns=mesh["columns"],
        rows=mesh["rows"],
        tile_columns=tile_columns,
        tile_rows=tile_rows,
        cores=tuple(cores),
    )


def _said(row: Document, what: str) -> str:
    return f"{core_words(row)}: {what}"


def _fullest(document: Document, row: Document) -> tuple[str, float]:
    """Return the limit of a core that is fullest, in words, and how full."""
    limits = document["resources"]["limits"]
    use = [(fullness(entry | {"used": row[name]}), name) for name, entry in limits.items() if name in row]
    full, name = max(use, key=lambda one: one[0])
    return words(name).replace(" of a core", ""), full
