"""The section that shows the cores in use at their places on the mesh.

Each chip is drawn twice: once its cores are filled by how full they are, once by their energy.
"""

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

_MAX_CHIPS = 4
"""Most chips that are drawn, chosen by hand; a board may have thousands."""
_MAX_TILES = 256
"""A chip with more tiles is not drawn, because numbers would not fit into its cores; chosen by hand."""
_MAX_NAMED = 8
"""Most cores that the text next to the picture names, chosen by hand."""
_LEAD = (
    "Each core at its place on the mesh, filled from below: first by the fullest of its limits, then "
    "by its energy relative to the core that uses most. Empty tiles are free."
)


class _Filled(Frozen):
    """A core as it is drawn: the share (0..1) of it that is filled, the text in it, and the share in words."""

    place: Place
    share: float
    text: str
    description: str


def cores(report: ReportFigures, energy_figures: EnergyFigures) -> Section:
    """Return the section with two meshes per chip: every core filled up to its fullest limit, and by its energy."""
    resources = report.resources
    tiles = resources.mesh.tiles
    by_chip: dict[int, list[CoreUse]] = {}
    for core in resources.by_core:
        # The tiles of a board are numbered through, with its chips side by side.
        chip = core.place.tile[0] // tiles.columns
        by_chip.setdefault(chip, []).append(core)
    drawn_chips = sorted(by_chip)[:_MAX_CHIPS] if tiles.tiles <= _MAX_TILES else []
    has_several_chips = resources.mesh.chips > 1
    meshes = []
    for chip in drawn_chips:
        chip_name = f"chip {chip} of {report.target}" if has_several_chips else report.target
        meshes.append(_fullness_mesh(resources, chip, by_chip[chip], chip_name))
        meshes.append(_energy_mesh(resources, chip, by_chip[chip], energy_figures))
    left_out = len(by_chip) - len(drawn_chips)
    note = f"{plural(left_out, 'chip is', 'chips are')} not drawn; see core by core."
    return Section.of("cores", "Use of the cores", _LEAD, *meshes, note if left_out else None)


def _fullness_mesh(
    resources: ResourceFigures, chip: int, cores: Sequence[CoreUse], chip_name: str
) -> Mesh:
    """Draw the cores of a chip, filled by the fullest of their limits."""
    filled = []
    for core in cores:
        full, limit = _fullest(resources.limits, core)
        percent = f"{100 * full:.0f}"
        description = f"{share(full)} of its {limit}"
        filled.append(_Filled(core.place, full, percent, description))
    all_cores = plural(resources.mesh.cores_per_chip, "core")
    in_use = f"{count(len(cores))} of {all_cores} in use"
    title = f"Fullest limit of each core of {chip_name}, in percent: {in_use}"
    return _mesh(resources.mesh, chip, filled, title)


def _energy_mesh(
    resources: ResourceFigures, chip: int, cores: Sequence[CoreUse], figures: EnergyFigures
) -> Mesh:
    """Draw the cores of a chip, filled by their energy relative to the largest on the board."""
    # Cores that the energy figures do not list take none.
    pj_by_core = {core.place.core: 0.0 for core in resources.by_core}
    pj_by_core |= {core.place.core: core.pj for core in figures.by_core_pj}
    # Where no core takes any energy, all shares are 0 rather than 0 / 0.
    largest_pj = max(pj_by_core.values(), default=0.0) or 1.0
    total_pj = math.fsum(pj_by_core.values()) or 1.0
    filled = []
    for core in cores:
        pj = pj_by_core[core.place.core]
        percent = 100 * pj / total_pj
        # Two digits: 9.9, but 10; from 9.95 on, one decimal would show 10.0.
        decimals = 1 if percent < 9.95 else 0
        text = f"{percent:.{decimals}f}"
        description = f"{energy(pj)}, {share(pj / total_pj)} of all"
        filled.append(_Filled(core.place, pj / largest_pj, text, description))
    title = f"Energy, in percent of all cores, profile {figures.profile}"
    return _mesh(resources.mesh, chip, filled, title)


def _mesh(size: MeshSize, chip: int, cores: Sequence[_Filled], title: str) -> Mesh:
    """Draw cores at their places on a chip, and name the fullest of them."""
    tiles = size.tiles
    # The smallest square that holds the cores of a tile, less the rows that stay empty.
    tile_columns = math.isqrt(tiles.cores_per_tile - 1) + 1
    tile_rows = math.ceil(tiles.cores_per_tile / tile_columns)
    drawn = []
    for core in cores:
        # Slots count the cores of the board chip by chip, and those of a chip tile by tile.
        slot_on_chip = core.place.slot % size.cores_per_chip
        slot_in_tile = slot_on_chip % tiles.cores_per_tile
        inside_row, inside_column = divmod(slot_in_tile, tile_columns)
        board_column, tile_row = core.place.tile
        tile_column = board_column - chip * tiles.columns
        column = tile_column * tile_columns + inside_column
        row = tile_row * tile_rows + inside_row
        drawn.append(MeshCore(column, row, core.share, core.text))
    return Mesh(
        title=title,
        description=_names_of_fullest(cores),
        columns=tiles.columns,
        rows=tiles.rows,
        tile_columns=tile_columns,
        tile_rows=tile_rows,
        cores=tuple(drawn),
    )


def _names_of_fullest(cores: Sequence[_Filled]) -> str:
    """Describe the cores that are filled most, from the fullest down, and say how many follow."""
    fullest = sorted(cores, key=lambda core: -core.share)[:_MAX_NAMED]
    named = "; ".join(f"{core_words(core.place)}: {core.description}" for core in fullest)
    unnamed = len(cores) - len(fullest)
    return f"{named}; and {count(unnamed)} more" if unnamed else named


def _fullest(limits: Mapping[str, LimitUse], core: CoreUse) -> tuple[float, str]:
    """Return how full the fullest limit of a core is, 0..1, and its name in words.

    ``limits`` of the program hold the contents of its fullest cores; here those of ``core`` count.
    """
    contents = vars(core.contents)
    fullness_by_limit = {
        name: fullness(LimitUse(contents[name], use.limit))
        for name, use in limits.items()
        if name in contents
    }
    name = max(fullness_by_limit, key=fullness_by_limit.__getitem__)
    return fullness_by_limit[name], words(name)
