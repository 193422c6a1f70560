"""Picojoules of an 8-bit multiply-accumulate in the same cells and macros, with the memories that feed it.

The page compares the spiking core with conventional networks by it. The unit is ``mac.sv``; it is synthesised, simulated with
random weights and activations, and priced as the core is. Its glitches are counted as well, for a bound on the core's.
"""

from pathlib import Path

import gates
import netlist
import numpy as np
import picojoules
import runs
import timing

CYCLES = 72
"""Cycles that are counted: nine rows of eight products."""
LANES = 512
"""Independent runs at once, an element of a numpy array each."""
WARM_UP_CYCLES = 8
"""The first row is not counted: the sum is cleared with it, and the registers hold zeros before."""
ROW = 8
"""Weights or activations in a row of a memory; a row serves as many cycles."""


def toggles(
    found: gates.Circuit, cells: dict, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, int]:
    """Play products of random weights and activations.

    Return transitions by net without delays, transitions by net with one unit of delay for every gate (where a net may change
    several times in a cycle: glitches), and the number of cycles that were counted. Weights are normally distributed with a
    deviation of 32; half of the activations are 0, as behind a rectifier.
    """
    functions = []
    for instance in found.order:
        cell = cells[instance.type]
        for pin in cell.outputs:
            if instance.pins.get(pin):
                net_of_pin = {p: f"v[{found.at(instance, p)}]" for p in cell.inputs}
                constant = {"0": "zero", "1": "one"}.get(cell.pins[pin].function)
                functions.append(
                    (
                        found.at(instance, pin),
                        constant or gates.expression(cell.pins[pin].function, net_of_pin),
                    )
                )
    # `logic` computes net after net, in the order of levels; `unit` computes all nets at once from those before, which is
    # what one unit of delay for every gate means.
    body = "\n".join(f"    v[{net}] = {constant}" for net, constant in functions)
    at_once = (
        ", ".join(f"v[{net}]" for net, _ in functions)
        + " = "
        + ", ".join(constant for _, constant in functions)
    )
    scope: dict = {}
    exec(f"def logic(v, zero, one):\n{body}\ndef unit(v, zero, one):\n    {at_once}\n", scope)
    zero, one = np.zeros(LANES, dtype=bool), np.ones(LANES, dtype=bool)
    values_now = [zero] * found.nets
    values_now[1] = one
    count, by_units = np.zeros(found.nets), np.zeros(found.nets)
    before, slow = list(values_now), list(values_now)
    for cycle in range(CYCLES + WARM_UP_CYCLES):
        if cycle % ROW == 0:
            weights = np.clip(np.rint(rng.normal(0, 32, (ROW, LANES))), -128, 127).astype(np.int64)
            activations = np.clip(np.rint(np.abs(rng.normal(0, 48, (ROW, LANES)))), 0, 127) * (
                rng.random((ROW, LANES)) < 0.5
            )
            for name, values in (
                ("weights", weights),
                ("activations", activations.astype(np.int64)),
            ):
                for bit, net in enumerate(found.port(name)):
                    values_now[net] = (values[bit // 8] >> (bit % 8) & 1).astype(bool)
        values_now[found.port("clear")[0]] = one if cycle == 0 else zero
        # The slow copy starts a cycle with the outputs of flip-flops and the inputs, and then runs until nothing changes.
        for net in _starts(found):
            if cycle >= WARM_UP_CYCLES:
                by_units[net] += np.count_nonzero(slow[net] != values_now[net])
            slow[net] = values_now[net]
        scope["logic"](values_now, zero, one)
        while any(
            slow[net] is not values_now[net] and (slow[net] != values_now[net]).any()
            for net, _ in functions
        ):
            slow_before = list(slow)
            scope["unit"](slow, zero, one)
            if cycle >= WARM_UP_CYCLES:
                by_units += [
                    np.count_nonzero(a != b) if a is not b else 0
                    for a, b in zip(slow, slow_before, strict=True)
                ]
        if cycle >= WARM_UP_CYCLES:
            count += [
                np.count_nonzero(a != b) if a is not b else 0
                for a, b in zip(values_now, before, strict=True)
            ]
        before = list(values_now)
        flop_data = [values_now[found.at(flop, "D")] for flop in found.flops]
        for flop, value in zip(found.flops, flop_data, strict=True):
            values_now[found.at(flop, "Q")] = value
    return count, by_units, CYCLES * LANES


def _starts(found: gates.Circuit) -> list[int]:
    """Return the nets at which paths begin: outputs of flip-flops and inputs."""
    inputs = [net for name in ("clear", "weights", "activations") for net in found.port(name)]
    return [*inputs, *(found.at(flop, "Q") for flop in found.flops)]


def measure(files: runs.Library) -> dict[str, float]:
    """Return what a product costs.

    ``area``: square micrometres of the unit. ``glitches``: transitions with unit delays over those without. ``END logic``,
    ``END clock`` (pJ) and ``END ns``: at the end ``least``, without wires, and ``most``, with wires and a clock tree.
    ``weights`` and ``activations``: picojoules of reading one of each.
    """
    folder = runs.KEPT / "mac"
    if not (folder / "netlist.json").exists():
        netlist.synthesise_module(
            folder, "mac", [Path(__file__).parent / "mac.sv"], files.folder / runs.CELLS
        )
    found = gates.circuit(netlist.load(folder / "netlist.json", "mac"), files.cells, {})
    area = sum(files.cells[i.type].area for i in found.netlist.instances)
    count, by_units, cycles = toggles(found, files.cells, np.random.default_rng(0))
    result = {"area": area, "glitches": float(by_units.sum() / count.sum())}
    for name, wires in (("least", timing.Wires()), ("most", timing.wires_for(files.group, area))):
        timings = timing.analyse(found, files.cells, {}, wires)
        energy = picojoules.measure(
            found,
            files.cells,
            {},
            timings,
            count[:, None],
            np.array([cycles]),
            np.zeros((0, 2, 1)),
            name == "most",
        )
        result |= {
            f"{name} logic": float(energy.of("logic")[0]) / cycles,
            f"{name} clock": float(energy.of("clock")[0]) / cycles,
        }
        result |= {f"{name} ns": timings.worst}
    # Both come from a macro of 256 words of 64 bits, and a row of eight values is read once for eight products.
    macro = next(m for m in files.macros.values() if (m.words, m.bits, m.ports) == (256, 64, 1))
    result["weights"] = result["activations"] = macro.read_pj / ROW
    return result
