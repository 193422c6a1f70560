"""Loads, transitions and arrival times of a netlist: a static timing analysis over the liberty tables.

It is graph based: every net has one arrival time, the latest of all paths to it, by the worse of both edges and of all arcs. The
clock is ideal, no path is known to be false, and wires have the capacitance of a model or none. Energies use loads and
transition times (:mod:`picojoules`), the page the longest path.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from gates import Circuit
from liberty import Cell, Group, Macro

CLOCK_NS = 0.1
"""Transition time of clock pins and of the core's inputs, in nanoseconds. Chosen by hand."""
CLOCK_GATE_SETUP_NS = 0.1
"""Setup time of the enable of a clock gate. Chosen by hand."""


@dataclass(frozen=True)
class Wires:
    """Picofarads of a wire by how many pins it drives, as a ``wire_load`` group of the library says; by default 0.

    ``fanouts`` and ``lengths``: a table of lengths. ``slope``: length for each pin more. ``capacitance``: of a unit of length.
    """

    name: str = "none"
    capacitance: float = 0.0
    slope: float = 0.0
    fanouts: tuple[float, ...] = (0.0, 1.0)
    lengths: tuple[float, ...] = (0.0, 0.0)
    line: int = 0

    def pf(self, _net: int, fanout: int) -> float:
        """Return the capacitance of a net."""
        last = self.fanouts[-1]
        length = (
            float(np.interp(min(fanout, last), self.fanouts, self.lengths))
            + max(fanout - last, 0) * self.slope
        )
        return length * self.capacitance


def wires_for(library: Group, area: float) -> Wires:
    """Return the wire load that the library selects for an area of cells, in square micrometres."""
    (selection,) = library.all("wire_load_selection")
    name = next(
        row[2]
        for row in selection.complex["wire_load_from_area"]
        if float(row[0]) <= area < float(row[1])
    )
    group = next(group for group in library.all("wire_load") if group.arguments[0] == name)
    rows = [(0.0, 0.0), *((float(a), float(b)) for a, b in group.complex["fanout_length"])]
    fanouts, lengths = zip(*rows, strict=True)
    return Wires(
        name, group.number("capacitance"), group.number("slope"), fanouts, lengths, group.line
    )


Path = tuple[str, ...]
# The modules that an instance lies in, from the top down. A last "" stands for the module's own cells, without modules in it.


def block_of(name: str) -> Path:
    """Return the modules, from the top down, that an instance of a flat netlist lies in."""
    plain = name.replace("$flatten", "").replace("\\", "")
    path = plain.split("$")[0].split(".")
    return tuple(path[:-1])


class Blocks:
    """Wires of modules that are placed as blocks: a net has the load for the area over which its pins may lie.

    This is the area of a module's own cells if all pins of the net are there, and else all of the smallest module that holds
    the pins. Macros, and ``arrays`` of latches, which are placed like macros, do not add to the area around them.
    ``flat``: outside of arrays every net has the load for the area of all logic, which is the library's own mode.
    """

    def __init__(
        self,
        library: Group,
        found: Circuit,
        cells: Mapping[str, Cell],
        arrays: Collection[str] = (),
        flat: bool = False,
    ) -> None:
        self.area: dict[Path, float] = {(): 0.0}
        path_and_instance = [(block_of(i.name), i) for i in found.netlist.instances]
        for path, instance in path_and_instance:
            if instance.type not in cells:
                continue
            array_depth = max((k + 1 for k, name in enumerate(path) if name in arrays), default=0)
            for depth in range(array_depth, len(path) + 1):
                self.area[path[:depth]] = (
                    self.area.get(path[:depth], 0.0) + cells[instance.type].area
                )
            # The module's own cells, also by themselves.
            own = (*path, "")
            self.area[own] = self.area.get(own, 0.0) + cells[instance.type].area
        # The block of a net is the longest path that all its pins have in common; ports of the core lie in no module.
        self.block: dict[int, Path] = {
            found.net[bit]: () for _, bits in found.netlist.ports.values() for bit in bits
        }
        for path, instance in path_and_instance:
            own = (*path, "") if instance.type in cells else path[:-1]
            if flat and not set(path) & set(arrays):
                own = ()
            for bits in instance.pins.values():
                for bit in bits:
                    path_so_far = self.block.setdefault(found.net[bit], own)
                    common = sum(
                        1
                        for _ in takewhile(
                            lambda pair: pair[0] == pair[1], zip(path_so_far, own, strict=False)
                        )
                    )
                    self.block[found.net[bit]] = path_so_far[:common]
        self.wires = {path: wires_for(library, um2) for path, um2 in self.area.items()}

    def pf(self, net: int, fanout: int) -> float:
        """Return the capacitance of a net."""
        path = self.block.get(net, ())
        while path not in self.wires:
            path = path[:-1]
        return self.wires[path].pf(net, fanout)


@dataclass
class Timing:
    """What the analysis gives.

    By net: ``load`` (pF), ``fanout`` (pins), ``slew`` (transition time, ns) and ``arrival`` (ns).
    ``worst``: nanoseconds of the longest path. ``end``: where it ends. ``path``: its instances, from the first to the last.
    """

    load: np.ndarray
    fanout: np.ndarray
    slew: np.ndarray
    arrival: np.ndarray
    worst: float
    end: str
    path: list[str]


def loads(
    found: Circuit, cells: Mapping[str, Cell], macros: Mapping[str, Macro], wires: Wires | Blocks
) -> tuple[np.ndarray, np.ndarray]:
    """Return the load in picofarads and the number of pins of every net, wires included."""
    load, fanout = np.zeros(found.nets), np.zeros(found.nets, dtype=int)
    for instance in found.netlist.instances:
        if instance.type in macros:
            pins = {
                name: macros[instance.type].input_pf
                for name in instance.pins
                if not name.endswith("DOUT")
            }
        else:
            cell = cells[instance.type]
            pins = {name: cell.pins[name].capacitance for name in cell.inputs}
        for name, pf in pins.items():
            for bit in instance.pins.get(name, []):
                load[found.net[bit]] += pf
                fanout[found.net[bit]] += 1
    load += [wires.pf(net, int(pins)) for net, pins in enumerate(fanout)]
    return load, fanout


def analyse(
    found: Circuit, cells: Mapping[str, Cell], macros: Mapping[str, Macro], wires: Wires | Blocks
) -> Timing:
    """Return loads and times of every net."""
    load, fanout = loads(found, cells, macros, wires)
    slew, arrival = np.full(found.nets, CLOCK_NS), np.zeros(found.nets)
    # The net before on the latest path; -1: a path begins here.
    net_before = np.full(found.nets, -1)
    # Paths begin at flip-flops and memories ...
    for flop in found.flops:
        for pin in cells[flop.type].outputs:
            if flop.pins.get(pin):
                net = found.at(flop, pin)
                output_pin = cells[flop.type].pins[pin]
                for delay, transition in zip(
                    output_pin.delays, output_pin.transitions, strict=True
                ):
                    if delay.related == "CLK":
                        arrival[net] = delay.worst(CLOCK_NS, load[net])
                        slew[net] = transition.worst(CLOCK_NS, load[net])
    for memory in found.memories:
        macro = macros[memory.type]
        for port in "AB"[: macro.ports]:
            for bit in memory.pins.get(f"{port}_DOUT", []):
                arrival[found.net[bit]] = macro.output_ns
    # ... go through logic, in the order of levels, so the times of all inputs are known ...
    for instance in found.order:
        cell = cells[instance.type]
        for pin in cell.outputs:
            if not instance.pins.get(pin):
                continue
            net, output_pin = found.at(instance, pin), cell.pins[pin]
            slew[net] = 0.0
            for delay, transition in zip(output_pin.delays, output_pin.transitions, strict=True):
                source = found.at(instance, delay.related)
                # Nets 0 and 1 are constants; resets of latches are no paths.
                if source < 2 or (cell.kind == "latch" and delay.related not in ("D", "GATE")):
                    continue
                time = arrival[source] + delay.worst(slew[source], load[net])
                if time > arrival[net]:
                    arrival[net], net_before[net] = time, source
                slew[net] = max(slew[net], transition.worst(slew[source], load[net]))
    # ... and end at flip-flops, latches, clock gates and memories, each with its setup time.
    ends = [
        (arrival[found.at(f, "D")] + cells[f.type].pins["D"].setup, f.name, found.at(f, "D"))
        for f in found.flops
    ]
    # Latches close in the middle of a cycle, so a path to one counts twice.
    latches = [i for i in found.order if cells[i.type].kind == "latch"]
    ends += [(2 * arrival[found.at(i, "D")], i.name, found.at(i, "D")) for i in latches]
    ends += [
        (arrival[found.at(g, "GATE")] + CLOCK_GATE_SETUP_NS, g.name, found.at(g, "GATE"))
        for g in found.gates.values()
    ]
    for memory in found.memories:
        macro = macros[memory.type]
        for name, bits in memory.pins.items():
            if not name.endswith(("DOUT", "CLK")):
                ends += [
                    (
                        arrival[found.net[b]] + max(macro.setup_ns, 0.0),
                        f"{memory.name}.{name}",
                        found.net[b],
                    )
                    for b in bits
                ]
    worst, end, net = max(ends)
    path = []
    while net >= 0:
        instance = found.driver.get(net)
        path.append(
            f"{instance[0].name}/{instance[0].type} {arrival[net]:.2f} {load[net]:.3f}"
            if instance
            else "input"
        )
        net = net_before[net]
    return Timing(load, fanout, slew, arrival, float(worst), end, path[::-1])
