"""Picojoules of an 8-bit multiply-accumulate in the same cells and macros, with the memories that feed it."""

from pathlib import Path

import gates
import netlist
import numpy as np
import picojoules
import runs
import timing

CYCLES, LANES = 72, 512


def toggles(
    found: gates.Circuit, cells: dict, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, int]:
    """Play products of random weights and activations; return transitions by net, and how many cycles were counted.

    First without delays, then with one unit of delay for every gate, where nets change several times in a cycle. Weights are normal with a deviation of 32; half of the activations are 0, as behind a rectifier.
    """
    functions = []
    for instance in found.order:
        cell = cells[instance.type]
        for pin in cell.outputs:
            if instance.pins.get(pin):
                names = {p: f"v[{found.at(instance, p)}]" for p in cell.inputs}
                text = {"0": "zero", "1": "one"}.get(cell.pins[pin].function)
                functions.append(
                    (
                        found.at(instance, pin),
                        text or gates.expression(cell.pins[pin].function, names),
                    )
                )
    body = "\n".join(f"    v[{net}] = {text}" for net, text in functions)
    at_once = (
        ", ".join(f"v[{net}]" for net, _ in functions)
        + " = "
        + ", ".join(text for _, text in functions)
    )
    scope: dict = {}
    exec(f"def logic(v, zero, one):\n{body}\ndef unit(v, zero, one):\n    {at_once}\n", scope)
    zero, one = np.zeros(LANES, dtype=bool), np.ones(LANES, dtype=bool)
    v = [zero] * found.nets
    v[1] = one
    count, by_units = np.zeros(found.nets), np.zeros(found.nets)
    before, slow = list(v), list(v)
    for cycle in range(CYCLES + 8):
        if cycle % 8 == 0:
            weights = np.clip(np.rint(rng.normal(0, 32, (8, LANES))), -128, 127).astype(np.int64)
            rows = np.clip(np.rint(np.abs(rng.normal(0, 48, (8, LANES)))), 0, 127) * (
                rng.random((8, LANES)) < 0.5
            )
            for name, values in (("weights", weights), ("activations", rows.astype(np.int64))):
                for bit, net in enumerate(found.port(name)):
                    v[net] = (values[bit // 8] >> (bit % 8) & 1).astype(bool)
        v[found.port("clear")[0]] = one if cycle == 0 else zero
        for net in _starts(found):
            if cycle >= 8:
                by_units[net] += np.count_nonzero(slow[net] != v[net])
            slow[net] = v[net]
        scope["logic"](v, zero, one)
        while any(slow[net] is not v[net] and (slow[net] != v[net]).any() for net, _ in functions):
            past = list(slow)
            scope["unit"](slow, zero, one)
            if cycle >= 8:
                by_units += [
                    np.count_nonzero(a != b) if a is not b else 0
                    for a, b in zip(slow, past, strict=True)
                ]
        if cycle >= 8:
            count += [
                np.count_nonzero(a != b) if a is not b else 0
                for a, b in zip(v, before, strict=True)
            ]
        before = list(v)
        following = [v[found.at(flop, "D")] for flop in found.flops]
        for flop, value in zip(found.flops, following, strict=True):
            v[found.at(flop, "Q")] = value
    return count, by_units, CYCLES * LANES


def _starts(found: gates.Circuit) -> list[int]:
    """Return the nets at which paths begin: outputs of flip-flops and inputs."""
    inputs = [net for name in ("clear", "weights", "activations") for net in found.port(name)]
    return [*inputs, *(found.at(flop, "Q") for flop in found.flops)]


def measure(files: runs.Library) -> dict[str, float]:
    """Return picojoules of a product by part, at the upper end and in all at the lower one, and its area."""
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
        times = timing.analyse(found, files.cells, {}, wires)
        spent = picojoules.measure(
            found,
            files.cells,
            {},
            times,
            count[:, None],
            np.array([cycles]),
            np.zeros((0, 2, 1)),
            name == "most",
        )
        result |= {
            f"{name} logic": float(spent.of("logic")[0]) / cycles,
            f"{name} clock": float(spent.of("clock")[0]) / cycles,
        }
        result |= {f"{name} ns": times.worst}
    macro = next(m for m in files.macros.values() if (m.words, m.bits, m.ports) == (256, 64, 1))
    result["weights"] = result["activations"] = macro.read_pj / 8
    return result
