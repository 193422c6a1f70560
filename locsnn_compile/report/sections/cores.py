"""The section that shows the cores in use at their places on the mesh, how full each is, and its energy."""

import math
from collections.abc import Mapping, Sequence

from hw_model.values import Frozen
from locsnn_compile.report.content import Mesh, MeshCore, Section
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.energy import EnergyFigures
from locsnn_compile.report.figures.resources import CoreUse, LimitUse, MeshSize, ResourceFigures
from locsnn_compile.report.figures.spread import Place
from locsnn_compile.report.format import count, energy, plural, share
from locsnn_compile.report.sections.cost_tables import core_words
from locsnn_compile.report.sections.verdict import fullness
from locsnn_compile.report.words import words

_CHIPS = 4
"""Most chips that are drawn; a board may have thousands."""
_TILES = 256
"""A chip with more tiles is not drawn."""
_NAMED = 8
"""Cores that the text next to the picture names."""
_LEAD = (
    "Each core at its place on the mesh, filled from below: first by the fullest of its limits, then "
    "by its energy relative to the core that uses most. Empty tiles are free."
)


class _Filled(Frozen):
    """A core, how far it is filled, 0..1, the text in it, and its description in words."""

    place: Place
    share: float
    text: str
    description: str


def cores(report: ReportFigures, energy_figures: EnergyFigures) -> Section:
    """Two meshes per chip: every core filled up to its fullest limit, and by its energy."""
    resources = report.resources
    tiles = resources.mesh.tiles
    by_chip: dict[int, list[CoreUse]] = {}
    for core in resources.by_core:
        by_chip.setdefault(core.place.tile[0] // tiles.columns, []).append(core)
    drawn = sorted(by_chip.items())[:_CHIPS] if tiles.tiles <= _TILES else []
    meshes = []
    for chip, on_chip in drawn:
        of_chip = f"chip {chip} of {report.target}" if resources.mesh.chips > 1 else report.target
        meshes.append(_room(resources, chip, on_chip, of_chip))
        meshes.append(_energy(resources, chip, on_chip, energy_figures))
    left_out = len(by_chip) - len(drawn)
    note = f"{plural(left_out, 'chip is', 'chips are')} not drawn; see core by core."
    return Section.of("cores", "Use of the cores", _LEAD, *meshes, note if left_out else None)


def _room(resources: ResourceFigures, chip: int, cores: Sequence[CoreUse], of_chip: str) -> Mesh:
    every = plural(resources.mesh.cores_per_chip, "core")
    filled = []
    for core in cores:
        full, limit = _fullest(resources.limits, core)
        text, description = f"{100 * full:.0f}", f"{share(full)} of its {limit}"
        filled.append(_Filled(core.place, full, text, description))
    in_use = f"{count(len(cores))} of {every} in use"
    title = f"Fullest limit of each core of {of_chip}, in percent: {in_use}"
    return _mesh(resources.mesh, chip, filled, title)


def _energy(
    resources: ResourceFigures, chip: int, cores: Sequence[CoreUse], figures: EnergyFigures
) -> Mesh:
    energies = {core.place.core: 0.0 for core in resources.by_core}
    energies |= {core.place.core: core.pj for core in figures.by_core_pj}
    most = max(energies.values(), default=0.0) or 1.0
    total = math.fsum(energies.values()) or 1.0
    filled = []
    for core in cores:
        pj = energies[core.place.core]
        percent = 100 * pj / total
        text = f"{percent:.{int(percent < 9.95)}f}"
        description = f"{energy(pj)}, {share(pj / total)} of all"
        filled.append(_Filled(core.place, pj / most, text, description))
    title = f"Energy, in percent of all cores, profile {figures.profile}"
    return _mesh(resources.mesh, chip, filled, title)


def _mesh(size: MeshSize, chip: int, cores: Sequence[_Filled], title: str) -> Mesh:
    """Draw cores by their use, and name those with the most."""
    tiles = size.tiles
    tile_columns = math.isqrt(tiles.cores_per_tile - 1) + 1
    tile_rows = -(-tiles.cores_per_tile // tile_columns)
    drawn = []
    for core in cores:
        slot_in_tile = core.place.slot % size.cores_per_chip % tiles.cores_per_tile
        inside_row, inside_column = divmod(slot_in_tile, tile_columns)
        tile_column = core.place.tile[0] - chip * tiles.columns
        column = tile_column * tile_columns + inside_column
        row = core.place.tile[1] * tile_rows + inside_row
        drawn.append(MeshCore(column, row, core.share, core.text))
    named = sorted(cores, key=lambda core: -core.share)[:_NAMED]
    said = "; ".join(f"{core_words(core.place)}: {core.description}" for core in named)
    more = f"; and {count(len(cores) - _NAMED)} more" if len(cores) > _NAMED else ""
    return Mesh(
        title, said + more, tiles.columns, tiles.rows, tile_columns, tile_rows, tuple(drawn)
    )


def _fullest(limits: Mapping[str, LimitUse], core: CoreUse) -> tuple[float, str]:
    """Return how full the fullest limit of a core is, and its name in words."""
    contents = vars(core.contents)
    fullness_by_limit = [
        (fullness(LimitUse(contents[name], use.limit)), name)
        for name, use in limits.items()
        if name in contents
    ]
    full, name = max(fullness_by_limit, key=lambda pair: pair[0])
    return full, words(name)
