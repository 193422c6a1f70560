"""Compare the core with the simulator: spikes, registers, counts, scores, classes and cycles.

``locsnn rtl sim`` and the tests play recordings on both, the core in a simulator of SystemVerilog,
and count how many values differ.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hw_model.engine.playing import Spikes, read_streams
from hw_model.engine.probes import Kind
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.cosimulation import ANSWER, ANSWER_COUNTS, PATIENCE, play_on_core
from hw_model.rtl.cycles import predicted_cycles
from hw_model.rtl.images import SIMULATED, CoreProgram, Sizes
from hw_model.rtl.simulators import Simulator
from hw_model.simulation import simulate

KINDS: tuple[Kind, ...] = ("spikes", "u", "v", "potential")


def compare(
    program: ChipProgram,
    spikes: Spikes,
    texts: Mapping[str, str],
    simulator: Simulator = "verilator",
    sizes: Sizes = SIMULATED,
    patience: int = PATIENCE,
) -> dict[str, Any]:
    """Play recordings on the simulator and on the core, and return how many values differ.

    Cycles are compared with those that :mod:`hw_model.rtl.cycles` predicts, and counted apart from
    values.

    - ``spikes``: a batch, (batch, steps, channels)
    - ``texts``: the SystemVerilog of the core, by the names of its files
    - ``patience``: clock cycles without a sign of life after which the run ends
    - ``sizes``: the sizes of the core, if the chip is not an open core, which has sizes of its own
    """
    expected = simulate(program, spikes, probe=KINDS)
    on_core, answers = play_on_core(
        program,
        spikes,
        steps=None,
        probe=KINDS,
        simulator=simulator,
        texts=texts,
        sizes=sizes,
        patience=patience,
    )
    core_figures = dict(zip(ANSWER, answers.T, strict=True))
    # Pairs of arrays to compare: (of the simulator, of the core).
    pairs: list[tuple[Any, Any]] = []
    for kind in KINDS:
        of_core = getattr(on_core, kind)
        for name, simulated in getattr(expected, kind).items():
            pairs.append((simulated, of_core[name]))
    for name in ANSWER_COUNTS:
        pairs.append(([counts[name] for counts in expected.per_recording], core_figures[name]))
    no_error = [0]
    pairs.append((no_error, core_figures["error"]))
    if expected.scores is not None:
        pairs.append((expected.scores, on_core.scores))
        pairs.append((expected.prediction, core_figures["class"]))
    streams, _ = read_streams(program, spikes)
    # (batch, steps, channels) of all inputs, side by side.
    recordings = np.concatenate(list(streams.values()), axis=2)
    core = CoreProgram(
        program, recordings.shape[1], steps=None, sizes=program.chip.open_core or sizes
    )
    predicted = predicted_cycles(core, recordings, expected.spikes)
    cycles = core_figures["cycles"].tolist()
    return {
        "recordings": len(recordings),
        "compared_values": sum(np.size(of_core) for _, of_core in pairs),
        "mismatches": sum(
            int(np.count_nonzero(simulated != of_core)) for simulated, of_core in pairs
        ),
        "cycles": cycles,
        "predicted_cycles": predicted,
        "cycle_mismatches": sum(
            taken != expected_cycles
            for taken, expected_cycles in zip(cycles, predicted, strict=True)
        ),
    }
