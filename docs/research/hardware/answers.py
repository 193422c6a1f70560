"""How many cycles after the last word of a recording the open core gives its class: tables of time-to-the-answer.md.

    python docs/research/hardware/answers.py [--programs FOLDER]

Cycles are counted in a simulation of the RTL, and must equal the prediction, which also says which part of the work they are for.
``--programs``: the folder in which play_all.py keeps compiled programs.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from play_all import program_of
from shipped import MODELS, ROOT, example_files, model_file

import hw_model as hw
import locsnn_compile as lc
from hw_model.description.open_core import Sizes
from hw_model.rtl import cycles
from hw_model.rtl.cosimulation import ANSWER, PATIENCE, play_on_core
from hw_model.rtl.images import SIMULATED, CoreProgram
from hw_model.rtl.simulators import sources
from locsnn_compile.request.recordings import recordings_for

sys.path.insert(0, str(ROOT / "tests/benchmarks"))
from page_section import put_section

PAGE = ROOT / "docs/research/hardware/time-to-the-answer.md"
HEAD = """\
| model | strategy | step that is under way | phases that follow | readout | after the last word | ms at {mhz:.0f} MHz |
| --- | --- | ---: | ---: | ---: | ---: | ---: |"""
ON_ARRIVAL = "ecp5-85f"
"""The device whose second phase receives its events when they arrive, and not after the recording."""


def timed_from_the_last_word() -> dict[str, str]:
    """Return the sources with a test bench that counts cycles from the last accepted word of a recording, not from the first.

    The bench starts to count at a word unless a recording has begun; here it starts again at each word.
    """
    bench = sources()["bench.sv"]
    for old, new in (
        ("if (in_valid && in_ready && !begun) begin", "if (in_valid && in_ready) begin"),
        ("if (in_valid && in_ready && word[17:16] == 3) begun <= 0;", ""),
    ):
        assert bench.count(old) == 1
        bench = bench.replace(old, new)
    return sources() | {"bench.sv": bench}


def parts(core: CoreProgram, recording: np.ndarray, spikes: dict[str, np.ndarray]) -> list[int]:
    """Return the predicted cycles after the last word: to the end of the first phase, from there to the end of all, and to the class.

    The prediction gives only the total, so the method that plays a phase is wrapped for this call: it notes when the last word was
    accepted and when each phase ended.
    """
    ends, accepted = [], []
    play = cycles._Clock.play

    def noting_play(clock, words, compartments, steps):
        def noting_words():
            for wait, word in words:
                yield wait, word
                if word == cycles.END:
                    accepted.append(clock.consumed)

        play(clock, noting_words(), compartments, steps)
        ends.append(clock.consumed)

    cycles._Clock.play = noting_play
    try:
        total = cycles.core_cycles(core, recording, spikes)
    finally:
        cycles._Clock.play = play
    return np.diff([accepted[0], ends[0], ends[-1], total]).tolist()


def row(model: str, strategy: str, programs: Path | None, sizes: Sizes, mhz: float) -> str | None:
    """Return the row of a program on a core of these sizes.

    None if such a core delivers events on arrival (``later``), but cannot for this program.
    """
    network = lc.load(model_file(model))
    program = program_of(model, strategy, network, programs)
    recordings = recordings_for(network, example_files(model)[0])
    spikes = network.fit(recordings.spikes, recordings.source)
    core = CoreProgram(program, spikes.shape[1], steps=None, sizes=sizes)
    if sizes.later and not core.later:
        return None
    simulated = hw.simulate(program, spikes, probe=("spikes",))
    predicted = [
        parts(
            core,
            recording,
            {
                name: spikes_of_population[index]
                for name, spikes_of_population in simulated.spikes.items()
            },
        )
        for index, recording in enumerate(spikes)
    ]
    answers = play_on_core(
        program,
        spikes,
        steps=None,
        probe=(),
        simulator="verilator",
        texts=timed_from_the_last_word(),
        sizes=sizes,
        patience=PATIENCE,
    )[1]
    rtl_cycles = answers[:, ANSWER.index("cycles")]
    assert rtl_cycles.tolist() == [sum(recording) for recording in predicted], (
        rtl_cycles,
        predicted,
    )
    means, mean_cycles = np.mean(predicted, axis=0), rtl_cycles.mean()
    cells = " | ".join(f"{value:,.0f}" for value in (*means, mean_cycles))
    return f"| `{model}` | `{strategy}` | {cells} | {mean_cycles / mhz / 1000:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--programs", type=Path)
    programs, arrival = parser.parse_args().programs, hw.chip(ON_ARRIVAL)
    for section, sizes, mhz in (
        ("answers", SIMULATED, 100.0),
        ("arrivals", arrival.open_core, 1000 * arrival.clock_ghz),
    ):
        rows = [row(model, strategy, programs, sizes, mhz) for model, strategy in MODELS]
        put_section(PAGE, section, "\n".join([HEAD.format(mhz=mhz), *filter(None, rows)]))


if __name__ == "__main__":
    main()
