"""What a device has left with the open core placed on it, added to the report of a build."""

import json
import re
from collections.abc import Mapping

from hw_model.values import Frozen
from locsnn_compile.report.content import Bar, Facts, Section, Table
from locsnn_compile.report.format import count, plural, share
from locsnn_compile.report.renderers.html import section_html, text
from locsnn_compile.report.renderers.markdown import section_markdown

REPORTS = ("report.json", "report.md", "report.html")
_KEY, _TITLE = "device", "On the device"
_RESOURCES = {
    "luts": "LUTs",
    "flip_flops": "flip-flops",
    "block_rams": "block RAM",
    "multipliers": "multipliers",
}


class PlacedCore(Frozen):
    """The cells of a device that the core takes, by kind, all of them, and the slowest clock."""

    device: str
    used: Mapping[str, int]
    available: Mapping[str, int]
    fmax_mhz: float
    placements: int

    @property
    def shares(self) -> dict[str, float]:
        """The share of each kind that is used, the fullest first."""
        shares = {kind: self.used[kind] / cells for kind, cells in self.available.items() if cells}
        return dict(sorted(shares.items(), key=lambda pair: -pair[1]))


def with_placed(reports: Mapping[str, bytes], placed: PlacedCore) -> dict[str, bytes]:
    """Return the files of a report with a section on the device, in place of an earlier one."""
    section = _section(placed)
    document = json.loads(reports["report.json"])
    document["placed"] = {
        "device": placed.device,
        "used": dict(placed.used),
        "available": dict(placed.available),
        "fmax_mhz": placed.fmax_mhz,
        "placements": placed.placements,
    }
    plain = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
    texts = {
        "report.json": plain + "\n",
        "report.md": _in_markdown(reports["report.md"].decode(), section),
        "report.html": _in_page(reports["report.html"].decode(), section),
    }
    return {name: each.encode(errors="backslashreplace") for name, each in texts.items()}


def _section(placed: PlacedCore) -> Section:
    rows = []
    for kind, part in placed.shares.items():
        bar = Bar(part, f"{share(part)} used")
        used, available = count(placed.used[kind]), count(placed.available[kind])
        rows.append((_RESOURCES[kind], bar, used, available, share(part)))
    facts = {"clock": _clock(placed)}
    fullest = next(iter(placed.shares.items()), None)
    if fullest is not None:
        kind, part = fullest
        facts = {"fullest resource": f"{_RESOURCES[kind]}, {share(part)}"} | facts
    return Section.of(
        _KEY,
        _TITLE,
        f"What the open core takes of {placed.device}, whatever program it holds.",
        Facts.of(facts),
        Table("Cells of the device", ("resource", "", "used", "of", "share"), tuple(rows)),
    )


def _clock(placed: PlacedCore) -> str:
    return f"{placed.fmax_mhz:.1f} MHz, the slowest of {plural(placed.placements, 'placement')}"


def _in_markdown(report: str, section: Section) -> str:
    """Return the text with the section behind that on resources."""
    head, *sections = report.split("\n## ")
    others = [each for each in sections if not each.startswith(f"{_TITLE}\n")]
    titles = [each.split("\n", 1)[0] for each in others]
    place = titles.index("Resources") + 1
    added = section_markdown(section).removeprefix("## ").rstrip("\n") + "\n"
    return "\n## ".join([head, *others[:place], added, *others[place:]])


def _in_page(page: str, section: Section) -> str:
    """Return the page with the section behind that on resources, and a link to it."""
    link = f'<li><a href="#{_KEY}">{text(_TITLE)}</a></li>'
    earlier = re.compile(rf'<section class="section" aria-labelledby="{_KEY}">.*?</section>', re.S)
    page = earlier.sub("", page).replace(link, "")
    resources = re.compile(
        r'<section class="section" aria-labelledby="resources">.*?</section>', re.S
    )
    page = resources.sub(lambda found: found.group() + section_html(section), page, count=1)
    to_resources = '<li><a href="#resources">Resources</a></li>'
    return page.replace(to_resources, to_resources + link, 1)
