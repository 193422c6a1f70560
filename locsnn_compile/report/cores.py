"""The section that shows the cores in use where they sit on the mesh, and how full each is."""

from __future__ import annotations

import math

from locsnn_compile.report.content import Block, Document, Mesh, MeshCore, Paragraph, Section
from locsnn_compile.report.format import count, plural, share
from locsnn_compile.report.verdict import fullness
from locsnn_compile.report.words import words

_CHIPS = 4
"""Chips that are drawn; a board may have thousands."""
_TILES = 256
"""Tiles of a chip that are drawn at the most."""
_NAMED = 8
"""Cores that the words beside the picture name."""


def cores(document: Document) -> Section:
    """One mesh a chip, every core filled as far as its fullest limit."""
    found = document["resources"]
    mesh = found["mesh"]
    by_chip: dict[int, list[Document]] = {}
    for row in found["by_core"]:
        by_chip.setdefault(row["tile"][0] // mesh["columns"], []).append(row)
    blocks: list[Block] = []
    if mesh["columns"] * mesh["rows"] <= _TILES:
        blocks += [_mesh(document, chip, rows) for chip, rows in sorted(by_chip.items())[:_CHIPS]]
    left_out = len(by_chip) - len(blocks)
    if left_out:
        blocks.append(Paragraph(f"{plural(left_out, 'chip is', 'chips are')} not drawn; see core by core."))
    lead = (
        "Each core where it sits on the mesh, filled from below as far as the fullest of its limits, in percent. Empty "
        "tiles are free."
    )
    return Section("cores", "Use of the cores", lead, tuple(blocks))


def _mesh(document: Document, chip: int, rows: list[Document]) -> Mesh:
    mesh = document["resources"]["mesh"]
    tile_columns = math.isqrt(mesh["cores_per_tile"] - 1) + 1
    tile_rows = -(-mesh["cores_per_tile"] // tile_columns)
    cores = []
    for row in rows:
        inside_row, inside_column = divmod(row["slot"] % mesh["cores_per_chip"] % mesh["cores_per_tile"], tile_columns)
        column, tile_row = row["tile"][0] - chip * mesh["columns"], row["tile"][1]
        _, full = _fullest(document, row)
        cores.append(
            MeshCore(
                column * tile_columns + inside_column, tile_row * tile_rows + inside_row, full, f"{100 * full:.0f}"
            )
        )
    named = sorted(rows, key=lambda row: -_fullest(document, row)[1])[:_NAMED]
    of = f"Chip {chip} of {document['target']}" if document["resources"]["mesh"]["chips"] > 1 else document["target"]
    return Mesh(
        title=f"{of}: {plural(len(rows), 'core')} in use of {count(mesh['cores_per_chip'])}",
        description="; ".join(_said(document, row) for row in named)
        + (f"; and {count(len(rows) - len(named))} less full" if len(rows) > len(named) else ""),
        columns=mesh["columns"],
        rows=mesh["rows"],
        tile_columns=tile_columns,
        tile_rows=tile_rows,
        cores=tuple(cores),
    )


def _said(document: Document, row: Document) -> str:
    name, full = _fullest(document, row)
    what = words(name).replace(" of a core", "")
    return f"core {row['core']}, {words(row['phase'])}: {share(full)} of its {what}"


def _fullest(document: Document, row: Document) -> tuple[str, float]:
    """Return the limit of a core that is fullest, and how full."""
    limits = document["resources"]["limits"]
    use = {
        name: fullness({"used": row[name], "limit": entry["limit"]}) for name, entry in limits.items() if name in row
    }
    name = max(use, key=lambda name: use[name])
    return name, use[name]
