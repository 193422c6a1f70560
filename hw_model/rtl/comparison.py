"""The core against the simulator: every spike, u, v, potential, count and class, and every cycle predicted."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hw_model.engine.playing import Spikes, read_streams
from hw_model.engine.probes import Kind
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.cosimulation import ANSWER, PATIENCE, play_on_core
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
    """Return what was compared, and how often the two differ; ``spikes`` are a batch, (batch, steps, channels)."""
    expected = simulate(program, spikes, probe=KINDS)
    found, answers = play_on_core(program, spikes, None, KINDS, simulator, texts, sizes, patience)
    of_core = dict(zip(ANSWER, answers.T, strict=True))
    kept = [(getattr(expected, kind), getattr(found, kind)) for kind in KINDS]
    pairs = [(ours[name], theirs[name]) for ours, theirs in kept for name in ours]
    pairs += [
        ([counts[name] for counts in expected.per_recording], of_core[name]) for name in ANSWER[3:]
    ]
    pairs += [([0], of_core["error"])]
    if expected.scores is not None:
        pairs += [(expected.scores, found.scores), (expected.prediction, of_core["class"])]
    recordings = np.concatenate(list(read_streams(program, spikes)[0].values()), axis=2)
    core = CoreProgram(program, recordings.shape[1], None, program.chip.open_core or sizes)
    predicted = predicted_cycles(core, recordings, expected.spikes)
    cycles = of_core["cycles"].tolist()
    return {
        "recordings": len(recordings),
        "compared_values": sum(np.size(theirs) for _, theirs in pairs),
        "mismatches": sum(int(np.count_nonzero(ours != theirs)) for ours, theirs in pairs),
        "cycles": cycles,
        "predicted_cycles": predicted,
        "cycle_mismatches": sum(a != b for a, b in zip(cycles, predicted, strict=True)),
    }
