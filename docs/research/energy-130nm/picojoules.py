"""Picojoules of what happened in a netlist: macros, cells, loads and clock pins, by part of the core.

Counted transitions (:mod:`gates`) are multiplied by what the library says of each: a cell's internal energy at its input
transition and load, and half of C V^2 for the net that it drives. Clock pins switch twice in every cycle in which they tick.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from gates import Circuit
from liberty import Cell, Macro
from timing import CLOCK_NS, Timing

VOLTS = 1.2
TREE_FANOUT, TREE_BUFFER = 16, "sg13g2_buf_8"
"""The model of the clock tree at the upper end of the range: a buffer for every sixteen pins, level by level."""
CLOCK_PIN_PF = 0.003
"""Capacitance of a clock pin that the buffers of the tree are priced for, about that of the library's flip-flops."""
CLOCKED = {"ff": "CLK", "gate": "CLK", "latch": "GATE"}
"""The clock pin of each kind of cell."""
OPENS = {"ff": "CLK", "latch": "GATE"}
"""The pin at which the output of a cell that keeps a bit changes."""
PARTS = {
    "compartments": "updates", "deliver": "delivery", "charges": "accumulator", "banks": "accumulator", "buffer": "transpose buffer",
    "events": "control", "spikes": "control", "decide": "readout", "counts": "counters",
}  # fmt: skip


def part_of(name: str) -> str:
    """Return the part of the core that an instance belongs to, by the top module in its name; what is in none is control."""
    return PARTS.get(
        name.replace("$flatten", "").replace("\\", "").split(".")[0].split("[")[0], "control"
    )


def memory_of(name: str) -> str:
    """Return the memory that a macro belongs to; the halves for even and odd words count as one memory."""
    memory = name.replace("\\", "").split(".")[-2]
    return memory[:-1] if memory.endswith(("_same0", "_same1")) else memory


@dataclass
class Energy:
    """Picojoules by kind and part, each (columns,): of recordings, or of classes of cycles.

    ``memory``: accesses of macros. ``logic``: transitions of cells, of the nets they drive, and of macro inputs.
    ``clock``: clock pins, clock gates and the clock tree.
    """

    memory: dict[str, np.ndarray]
    logic: dict[str, np.ndarray]
    clock: dict[str, np.ndarray]

    def part(self, begin: int, end: int) -> "Energy":
        """Return the energy of some of the columns."""
        kinds = (self.memory, self.logic, self.clock)
        return Energy(*({name: pj[begin:end] for name, pj in kind.items()} for kind in kinds))

    def of(self, kind: str) -> np.ndarray:
        """Return the sum over all parts of a kind."""
        return sum(getattr(self, kind).values())

    @property
    def total(self) -> np.ndarray:
        """The sum over all kinds and parts."""
        return sum((*self.memory.values(), *self.logic.values(), *self.clock.values()))


def measure(
    found: Circuit,
    cells: Mapping[str, Cell],
    macros: Mapping[str, Macro],
    timing: Timing,
    toggles: np.ndarray,
    cycles: np.ndarray,
    accesses: np.ndarray,
    tree: bool,
) -> Energy:
    """Return the energy of columns (recordings or classes): ``toggles`` (nets, n), ``cycles`` (n,), ``accesses`` (ports, 2, n).

    ``tree``: a clock tree of a buffer for every sixteen pins is added; its wires are in the loads of ``timing``.
    """
    columns = toggles.shape[1]
    zero = np.zeros(columns)
    memory: dict[str, np.ndarray] = {}
    logic: dict[str, np.ndarray] = {}
    clock: dict[str, np.ndarray] = {}

    def add(where: dict[str, np.ndarray], part: str, pj: np.ndarray) -> None:
        where[part] = where.get(part, zero) + pj

    # Cells and the nets that they drive. Of a gate with several inputs, an output transition is priced by the mean over its
    # inputs, weighted by how often each changes.
    overall = toggles.sum(axis=1)
    half = 0.5 * VOLTS**2
    for instance in (*found.order, *found.flops):
        cell, part = cells[instance.type], part_of(instance.name)
        for pin in cell.outputs:
            if not instance.pins.get(pin):
                continue
            net = found.at(instance, pin)
            pj = half * timing.load[net]
            arcs = [a for a in cell.pins[pin].power if a.related in OPENS.get(cell.kind, a.related)]
            if arcs and overall[net]:
                if cell.kind in OPENS:
                    pj += arcs[0].mean(CLOCK_NS, timing.load[net])
                else:
                    sources = [found.at(instance, a.related) for a in arcs]
                    weights = np.array([overall[s] for s in sources], dtype=float)
                    pj_of_arc = [
                        a.mean(timing.slew[s], timing.load[net])
                        for a, s in zip(arcs, sources, strict=True)
                    ]
                    pj += (
                        float(np.average(pj_of_arc, weights=weights))
                        if weights.any()
                        else float(np.mean(pj_of_arc))
                    )
            add(logic, part, toggles[net] * pj)
    # The clock tree, as an energy per pin and tick: a buffer switches twice, and its input is a pin of the level above. With
    # levels of 16, 1/16 + 1/256 + ... = 1/15 buffers stand for each pin.
    buffer = cells[TREE_BUFFER]
    out = buffer.pins["X"]
    buffer_pf = buffer.pins["A"].capacitance
    leaf = TREE_FANOUT * CLOCK_PIN_PF
    per_pin = (
        (2 * out.power[0].mean(CLOCK_NS, leaf) + VOLTS**2 * buffer_pf) / (TREE_FANOUT - 1)
        if tree
        else 0.0
    )
    # Clock pins of flip-flops. The library lists the rising edge by data and output; the edge at which the output changes is
    # left out, as it is part of the energy of the output above.
    wire = _wire_share(found, timing)
    for flop in found.flops:
        cell, part = cells[flop.type], part_of(flop.name)
        pin = cell.pins["CLK"]
        states = {"".join(a.when.split()): a for a in pin.power}
        unchanged_arcs = [states["(D*RESET_B*Q)"], states["(!D*RESET_B*!Q)"]]
        all_arcs = [*unchanged_arcs, states["(D*RESET_B*!Q)"], states["(!D*RESET_B*Q)"]]
        rise = float(np.mean([a.tables[0].at(CLOCK_NS) for a in unchanged_arcs]))
        fall = float(np.mean([a.tables[1].at(CLOCK_NS) for a in all_arcs]))
        net = found.at(flop, "CLK")
        ticks = _ticks(found, net, toggles, cycles)
        changed = toggles[found.at(flop, "Q")]
        pj = (
            ticks * (rise + fall + VOLTS**2 * (pin.capacitance + (wire if tree else 0.0)) + per_pin)
            - changed * rise
        )
        add(clock, part, pj)
        data = cell.pins["D"]
        arcs = [a for a in data.power if "!RESET_B" not in a.when and a.when]
        if arcs:
            add(
                logic,
                part,
                toggles[found.at(flop, "D")]
                * float(np.mean([a.mean(CLOCK_NS, 0.0) for a in arcs])),
            )
    # Gate pins of latches. A gate that opens few latches needs no tree behind it.
    latches = [i for i in found.order if cells[i.type].kind == "latch"]
    pins_of_clock = Counter(
        found.at(i, CLOCKED[cells[i.type].kind])
        for i in (*found.flops, *found.gates.values(), *latches)
    )
    for latch in latches:
        cell, part = cells[latch.type], part_of(latch.name)
        pin, data = cell.pins["GATE"], cell.pins["D"]
        ticks = _ticks(found, found.at(latch, "GATE"), toggles, cycles)
        open_pj = max(sum(t.at(CLOCK_NS) for t in a.tables) for a in pin.power)
        tree_pj = per_pin if pins_of_clock[found.at(latch, "GATE")] > TREE_FANOUT else 0.0
        add(
            clock,
            part,
            ticks * (open_pj + VOLTS**2 * (pin.capacitance + (wire if tree else 0.0)) + tree_pj),
        )
        arcs = [a for a in data.power if "!GATE" in a.when]
        add(
            logic,
            part,
            toggles[found.at(latch, "D")] * float(np.mean([a.mean(CLOCK_NS, 0.0) for a in arcs])),
        )
    # Clock gates: their clock pin ticks with the clock above, their output only when they are open.
    for gated, gate in found.gates.items():
        cell = cells[gate.type]
        ticks_above = _ticks(found, found.at(gate, "CLK"), toggles, cycles)
        gated_ticks = _ticks(found, gated, toggles, cycles)
        pin, out = cell.pins["CLK"], cell.pins["GCLK"]
        pj = ticks_above * (
            sum(t.at(CLOCK_NS) for a in pin.power for t in a.tables)
            + VOLTS**2 * pin.capacitance
            + per_pin
        )
        pj = pj + gated_ticks * 2 * out.power[0].mean(
            CLOCK_NS, min(pins_of_clock[gated], TREE_FANOUT) * CLOCK_PIN_PF
        )
        (data_arc,) = [a for a in cell.pins["GATE"].power if a.when]
        pj = pj + toggles[found.at(gate, "GATE")] * data_arc.mean(CLOCK_NS, 0.0)
        add(clock, part_of(gate.name), pj)
    # Macros: accesses, and transitions of their pins. Ports are counted in the order of :func:`gates.source`.
    port = 0
    for instance in found.memories:
        macro = macros[instance.type]
        name = memory_of(instance.name)
        for letter in "AB"[: macro.ports]:
            add(
                memory, name, accesses[port, 0] * macro.read_pj + accesses[port, 1] * macro.write_pj
            )
            for pin, pj in macro.toggle_pj.items():
                for bit in instance.pins.get(letter + pin[1:], []):
                    add(logic, part_of(instance.name), toggles[found.net[bit]] * pj)
            for bit in instance.pins.get(f"{letter}_DOUT", []):
                net = found.net[bit]
                add(logic, part_of(instance.name), toggles[net] * half * timing.load[net])
            ticks = _ticks(found, found.at(instance, f"{letter}_CLK"), toggles, cycles)
            add(clock, part_of(instance.name), ticks * (VOLTS**2 * macro.input_pf / 2 + per_pin))
            port += 1
    return Energy(memory, logic, clock)


def _wire_share(found: Circuit, timing: Timing) -> float:
    """Return picofarads of wire per clock pin at the end of the tree, taken to be the mean load of a net with one pin.

    Nets 0 and 1 are constants.
    """
    sample = [n for n in range(2, found.nets) if timing.fanout[n] == 1]
    return float(timing.load[sample].mean()) if sample else 0.0


def _ticks(found: Circuit, clock: int, toggles: np.ndarray, cycles: np.ndarray) -> np.ndarray:
    """Return in how many cycles a clock ticks: a gated clock's transitions are its ticks, any other ticks in every cycle."""
    return toggles[clock] if clock in found.gates else cycles
