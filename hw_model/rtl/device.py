"""A program on the open core of a device: whether it fits, its cycles, and its memory accesses.

:mod:`hw_model.targets` asks these questions when a program is compiled for a device with an open
core.
"""

from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache

import numpy as np

from hw_model.accounting.cost import Latency
from hw_model.description.chip import Chip, chip, chip_names
from hw_model.description.counts import Counts
from hw_model.description.open_core import MemoryWords
from hw_model.engine.playing import Spikes, read_streams
from hw_model.errors import TargetError, listed
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.cycles import predicted_cycles
from hw_model.rtl.images import CoreProgram, Sizes
from hw_model.values import ByteArray

_core_program = lru_cache(maxsize=4)(CoreProgram)
"""As :class:`CoreProgram`. The last few are kept, as the questions about a program come one after
the other."""


def on_core(program: ChipProgram, rows: int, device: Chip) -> CoreProgram:
    """Return a program as the open core of a device holds it, for recordings of ``rows`` rows.

    Raise a ``TargetError`` if the program needs what the core does not have, or has too few of.
    """
    core = _core_program(program, rows, None, device.open_core)
    check_room(core, device)
    return core


def check_room(core: CoreProgram, device: Chip) -> None:
    """Raise a ``TargetError`` if a device's core is too small for a program, or its fields are."""
    assert device.open_core is not None
    for name, (need, limit) in _short_of(core, device).items():
        what = f"the open core of {device.name} is too small in {name!r}"
        measured = f"{need} against {limit}"
        raise TargetError(
            f"program {core.program.name!r}", what, measured=measured, fix=_way_out(core)
        )
    core.check_fields(device.open_core)


def _short_of(core: CoreProgram, device: Chip) -> dict[str, tuple[int, int]]:
    """Return the sizes in which a device's core is too small: (need, limit) by name."""
    assert device.open_core is not None
    words = uses(core.words, device.memory_words) if device.memory_words else {}
    all_uses = uses(core.needs, device.open_core) | words
    return {name: (need, limit) for name, (need, limit) in all_uses.items() if need > limit}


def uses(needs: Sizes | MemoryWords, sizes: Sizes | MemoryWords) -> dict[str, tuple[int, int]]:
    """Return what is needed and what there is (need, limit), by parameter of the core."""
    return {name: (need, getattr(sizes, name)) for name, need in asdict(needs).items()}


def latencies(
    program: ChipProgram, spikes: Spikes, fired: Mapping[str, ByteArray]
) -> list[Latency]:
    """Return the time of each recording of a batch on the core of the program's chip, cycle by cycle.

    ``fired[population]`` (batch, steps, n): the spikes that a simulation gives.
    """
    recordings = np.concatenate(list(read_streams(program, spikes)[0].values()), axis=2)
    core = on_core(program, recordings.shape[1], program.chip)
    cycles = predicted_cycles(core, recordings, fired)
    # The core has no mesh and no barrier: of the entries only the total is known.
    return [
        Latency(
            total_ns=count / program.chip.clock_ghz,
            by_phase_ns={},
            critical_core=0,
            after_last_row_ns=0.0,
            slowest_step_ns=0.0,
        )
        for count in cycles
    ]


def activity(core: CoreProgram, counts: Counts, recordings: int) -> dict[str, dict[str, float]]:
    """Return memory accesses and multiplications per recording, from counts of recordings.

    They are means. The cleaning of memories between recordings is left out. Writes are upper
    bounds: charges that are 0 when they are taken, and states of compartments at rest, are not
    written back.
    """
    updates = counts.neuron_updates
    lists = counts.input_events + counts.transpose_events + counts.spikes
    # A visit reads all words of its channel.
    scanned = 0 if core.later else recordings * len(core.tables["visits"]["step"]) * core.row_words
    written = {
        "charges": counts.synaptic_ops + updates,
        "states": updates,
        "transpose_buffer": counts.transpose_events,
        "queue": counts.spikes,
    }
    constants = {
        "synapses": counts.synaptic_ops,
        "axons": lists,
        "leaks": updates,
        "fires": updates,
    }
    means = {
        "memory_reads": {
            **written,
            "transpose_buffer": counts.transpose_events + scanned,
            **constants,
        },
        "memory_writes": written,
        "multiplications": {"of_24_and_13_bits": 2 * updates},
    }
    return {
        key: {name: number / recordings for name, number in row.items()}
        for key, row in means.items()
    }


def _way_out(core: CoreProgram) -> str:
    """Return a piece of advice: the devices that ship on which the program fits."""
    holding = []
    for name in chip_names():
        device = chip(name)
        if device.open_core is None:
            continue
        core_on_device = _core_program(core.program, core.rows, None, device.open_core)
        if not _short_of(core_on_device, device):
            holding.append(device.name)
    return f"Use the device {listed(holding, 'or')}." if holding else "Use a smaller network."
