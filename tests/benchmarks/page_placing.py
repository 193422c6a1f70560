"""The page of placing and routing."""

from __future__ import annotations

from page_figures import Found, made_by, percent, table

PLACING = ("build", "place", "arrange", "route")


def placement(records: dict[str, Found]) -> str:
    """Return placing and routing against size, and the hops saved."""
    size_rows = []
    for measured in records["sizes"]["sizes"]:
        parts = [measured.get(part, 0.0) for part in PLACING]
        size_rows.append(
            [
                f"{measured['compartments']:,}", f"{measured['synapses']:,}", str(measured["cores"]), *(f"{measured[part]:.2f}" if part in measured else "-" for part in PLACING),
                f"{sum(parts):.2f}", f"{sum(parts) / measured['synapses'] * 1e6:.2f}", f"{measured['placing_mib'] / 1024:.2f}",
            ]
        )  # fmt: skip
    head = [
        "compartments",
        "synapses",
        "cores",
        "build s",
        "place s",
        "arrange s",
        "route s",
        "total s",
    ]
    hop_rows = [
        [
            measured["name"], str(measured["cores"]), f"{measured['before']:,.0f}", f"{measured['after']:,.0f}",
            percent(1 - measured['after'] / measured['before']), f"{measured['seconds']:.2f}",
        ]
        for measured in records["hops"]["networks"]
    ]  # fmt: skip
    hop_head = [
        "network",
        "cores",
        "hops per step, network order",
        "arranged",
        "saved",
        "seconds to arrange",
    ]
    return f"""{table([*head, "s per million synapses", "peak GiB"], size_rows, left=0)}

*Build* makes the graph through `ProgramBuilder`, checks included; *route* also assembles the program. Time grows with the
number of synapses. *Arrange* moves cores that talk to each other closer together on the board. Its time grows with the cube
of the number of places for cores, so it is left out on boards of more than 1,024 places.

## Hops that arranging cores saves

{made_by("test_hops.py")} A hop is one link of the mesh that a spike crosses. The table compares the hops per step, if every compartment spikes
once, with cores in network order and with arranged cores.

{table(hop_head, hop_rows)}
"""


def placing_in_short(records: dict[str, Found]) -> str:
    """Return the sentences on the seconds per synapse, and on the hops that arranging saves."""
    sizes = records["sizes"]["sizes"]
    seconds = [sum(m.get(part, 0.0) for part in PLACING) for m in sizes]
    costs = [took / m["synapses"] * 1e6 for took, m in zip(seconds, sizes, strict=True)]
    saved = [1 - m["after"] / m["before"] for m in records["hops"]["networks"]]
    return (
        f"To build, place and route a million synapses takes {min(costs):.2f} to {max(costs):.2f} "
        f"seconds, up to {sizes[-1]['compartments']:,} compartments. Arranging the cores saves "
        f"{percent(min(saved))} to {percent(max(saved))} of the hops."
    )


def placing(records: dict[str, Found]) -> str:
    """Return placing and routing against size, and the hops that arranging saves."""
    return f"""## Placing and routing against size

{made_by("test_curves.py")} The networks of *cost against size* on a board of eight chips; cores are arranged up to 100,000 compartments.

{placement(records)}"""
