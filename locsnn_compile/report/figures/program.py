"""The contents of a program as figures, by which two builds are compared."""

import re
from dataclasses import asdict
from hashlib import sha256
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.program.write import program_arrays, program_document
from hw_model.values import AnyArray
from locsnn_compile.report.content import Document

_ORIGIN = ("name", "target", "provenance", "synapses_pruned")
"""Entries of a program that say where it came from; no spike, score or cost depends on them."""


def program_figures(program: hw.ChipProgram) -> Document:
    """Return the sizes and settings of every group of compartments, the sums of its weights, and the chip's registers.

    Settings are given by the least and the largest. Weights are those that are added to q.
    ``contents`` has a checksum of every kind of entry and array of the program's files, apart from its origin.
    """
    parts: dict[str, list[dict[str, AnyArray]]] = {}
    for core in program.cores:
        axons = core.axons
        weights = core.effective_weights
        for piece in core.slices:
            here = slice(piece.offset, piece.offset + piece.size)
            onto = (axons.target >= here.start) & (axons.target < here.stop)
            held = {
                "decay_u": core.setting("decay_u")[here],
                "decay_v": core.setting("decay_v")[here],
                "refractory": core.setting("refractory")[here],
                "threshold_voltage": core.threshold_voltage[here],
                "bias": core.bias[here],
                "synaptic_delay": axons.delay[onto],
                "weight": weights[onto],
            }
            parts.setdefault(piece.group, []).append(held)
    groups = {name: _group(its) for name, its in parts.items()}
    registers = asdict(program.chip.registers)
    return {
        "cores": len(program.cores),
        "registers": registers,
        "groups": groups,
        "contents": _contents(program),
    }


def _contents(program: hw.ChipProgram) -> dict[str, str]:
    chip = {
        key: value
        for key, value in asdict(program.chip).items()
        if key not in ("name", "description", "document")
    }
    parts: dict[str, Any] = {**program_document(program), "chip": chip}
    for core in parts.pop("cores"):
        for key, value in core.items():
            parts.setdefault(f"cores.{key}", []).append(value)
    for key, array in program_arrays(program).items():
        content = sha256(array.astype(np.int64).tobytes()).hexdigest()
        parts.setdefault(re.sub(r"\d+/", "s.", key), []).append((key, content))
    return {
        key: sha256(repr(value).encode()).hexdigest()[:12]
        for key, value in parts.items()
        if key not in _ORIGIN
    }


def _group(parts: list[dict[str, AnyArray]]) -> Document:
    found = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    weights = found["weight"].astype(np.int64)
    return {
        "compartments": len(found["decay_u"]),
        "synapses": len(weights),
        "weights_sum": int(weights.sum()),
        "weights_magnitude": int(np.abs(weights).sum()),
        **{f"least_{key}": int(values.min()) for key, values in found.items() if len(values)},
        **{f"largest_{key}": int(values.max()) for key, values in found.items() if len(values)},
    }
