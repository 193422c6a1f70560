"""Loads, transitions and arrival times of a netlist: a static analysis over the liberty tables.

Graph based: the worse of both edges and of all arcs, an ideal clock, no false paths, and wires of a model or none.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from gates import Circuit
from liberty import Cell, Group, Macro

CLOCK_NS = 0.1
"""Transition of clock pins and of the core's inputs."""


@dataclass(frozen=True)
class Wires:
    """Picofarads of a wire by how many pins it drives, as a ``wire_load`` group says; none: nothing."""

    name: str = "none"
    capacitance: float = 0.0
    slope: float = 0.0
    fanouts: tuple[float, ...] = (0.0, 1.0)
    lengths: tuple[float, ...] = (0.0, 0.0)
    line: int = 0

    def pf(self, fanout: int) -> float:
        """Return the capacitance of a net."""
        last = self.fanouts[-1]
        length = float(np.interp(min(fanout, last), self.fanouts, self.lengths)) + max(fanout - last, 0) * self.slope
        return length * self.capacitance


def wires_for(library: Group, area: float) -> Wires:
    """Return the wire load that the library selects for an area of cells, in square micrometres."""
    (selection,) = library.all("wire_load_selection")
    name = next(row[2] for row in selection.complex["wire_load_from_area"] if float(row[0]) <= area < float(row[1]))
    group = next(group for group in library.all("wire_load") if group.arguments[0] == name)
    rows = [(0.0, 0.0), *((float(a), float(b)) for a, b in group.complex["fanout_length"])]
    fanouts, lengths = zip(*rows, strict=True)
    return Wires(name, group.number("capacitance"), group.number("slope"), fanouts, lengths, group.line)


@dataclass
class Timing:
    """By net: ``load`` (pF), ``fanout``, ``slew`` and ``arrival`` (ns); ``worst``: the longest path, and where it ends."""

    load: np.ndarray
    fanout: np.ndarray
    slew: np.ndarray
    arrival: np.ndarray
    worst: float
    end: str
    path: list[str]


def loads(
    found: Circuit, cells: Mapping[str, Cell], macros: Mapping[str, Macro], wires: Wires
) -> tuple[np.ndarray, np.ndarray]:
    """Return picofarads and pins of every net."""
    load, fanout = np.zeros(found.nets), np.zeros(found.nets, dtype=int)
    for instance in found.netlist.instances:
        if instance.type in macros:
            pins = {name: macros[instance.type].input_pf for name in instance.pins if not name.endswith("DOUT")}
        else:
            cell = cells[instance.type]
            pins = {name: cell.pins[name].capacitance for name in cell.inputs}
        for name, pf in pins.items():
            for bit in instance.pins.get(name, []):
                load[found.net[bit]] += pf
                fanout[found.net[bit]] += 1
    load += [wires.pf(int(pins)) for pins in fanout]
    return load, fanout


def analyse(found: Circuit, cells: Mapping[str, Cell], macros: Mapping[str, Macro], wires: Wires) -> Timing:
    """Return loads and times of every net."""
    load, fanout = loads(found, cells, macros, wires)
    slew, arrival = np.full(found.nets, CLOCK_NS), np.zeros(found.nets)
    before = np.full(found.nets, -1)
    for flop in found.flops:
        for pin in cells[flop.type].outputs:
            if flop.pins.get(pin):
                net = found.at(flop, pin)
                out = cells[flop.type].pins[pin]
                for delay, transition in zip(out.delays, out.transitions, strict=True):
                    if delay.related == "CLK":
                        arrival[net] = delay.worst(CLOCK_NS, load[net])
                        slew[net] = transition.worst(CLOCK_NS, load[net])
    for memory in found.memories:
        macro = macros[memory.type]
        for port in "AB"[: macro.ports]:
            for bit in memory.pins.get(f"{port}_DOUT", []):
                arrival[found.net[bit]] = macro.output_ns
    for instance in found.order:
        cell = cells[instance.type]
        for pin in cell.outputs:
            if not instance.pins.get(pin):
                continue
            net, out = found.at(instance, pin), cell.pins[pin]
            slew[net] = 0.0
            for delay, transition in zip(out.delays, out.transitions, strict=True):
                source = found.at(instance, delay.related)
                if source < 2:
                    continue
                at = arrival[source] + delay.worst(slew[source], load[net])
                if at > arrival[net]:
                    arrival[net], before[net] = at, source
                slew[net] = max(slew[net], transition.worst(slew[source], load[net]))
    ends = [(arrival[found.at(f, "D")] + cells[f.type].pins["D"].setup, f.name, found.at(f, "D")) for f in found.flops]
    ends += [(arrival[found.at(g, "GATE")] + 0.1, g.name, found.at(g, "GATE")) for g in found.gates.values()]
    for memory in found.memories:
        macro = macros[memory.type]
        for name, bits in memory.pins.items():
            if not name.endswith(("DOUT", "CLK")):
                ends += [
                    (arrival[found.net[b]] + max(macro.setup_ns, 0.0), f"{memory.name}.{name}", found.net[b])
                    for b in bits
                ]
    worst, end, net = max(ends)
    path = []
    while net >= 0:
        instance = found.driver.get(net)
        path.append(
            f"{instance[0].name}/{instance[0].type} {arrival[net]:.2f} {load[net]:.3f}" if instance else "input"
        )
        net = before[net]
    return Timing(load, fanout, slew, arrival, float(worst), end, path[::-1])
