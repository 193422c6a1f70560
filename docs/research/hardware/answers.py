"""How long the answer takes after the last word of a recording: cycles of the RTL and the prediction, into a page of docs/research.

    python docs/research/hardware/answers.py [--programs FOLDER]

``--programs``: what play_all.py keeps.
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
"""The device whose second phase hears its events when they arrive."""


def timed_from_the_last_word() -> dict[str, str]:
    """Return the sources with a bench that counts from the last accepted word of a recording."""
    bench = sources()["bench.sv"]
    for old, new in (
        ("if (in_valid && in_ready && !begun) begin", "if (in_valid && in_ready) begin"),
        ("if (in_valid && in_ready && word[17:16] == 3) begun <= 0;", ""),
    ):
        assert bench.count(old) == 1
        bench = bench.replace(old, new)
    return sources() | {"bench.sv": bench}


def parts(core: CoreProgram, recording: np.ndarray, spikes: dict[str, np.ndarray]) -> list[int]:
    """Return the predicted cycles after the last word: to the end of the first phase, of all phases, and to the class."""
    ends, accepted = [], []
    play = cycles._Clock.play

    def noted(clock, words, compartments, steps):
        def seen():
            for wait, word in words:
                yield wait, word
                if word == cycles.END:
                    accepted.append(clock.consumed)

        play(clock, seen(), compartments, steps)
        ends.append(clock.consumed)

    cycles._Clock.play = noted
    try:
        total = cycles.core_cycles(core, recording, spikes)
    finally:
        cycles._Clock.play = play
    return np.diff([accepted[0], ends[0], ends[-1], total]).tolist()


def row(model: str, strategy: str, kept: Path | None, sizes: Sizes, mhz: float) -> str | None:
    """Return a row for the core of these sizes, or None if they are to hear events on arrival, and do not for this program."""
    network = lc.load(model_file(model))
    program = program_of(model, strategy, network, kept)
    recordings = recordings_for(network, example_files(model)[0])
    spikes = network.fit(recordings.spikes, recordings.source)
    core = CoreProgram(program, spikes.shape[1], None, sizes)
    if sizes.later and not core.later:
        return None
    found = hw.simulate(program, spikes, probe=("spikes",))
    predicted = [
        parts(core, one, {name: its[index] for name, its in found.spikes.items()})
        for index, one in enumerate(spikes)
    ]
    answers = play_on_core(
        program, spikes, None, (), "verilator", timed_from_the_last_word(), sizes, PATIENCE
    )[1]
    of_rtl = answers[:, ANSWER.index("cycles")]
    assert of_rtl.tolist() == [sum(one) for one in predicted], (of_rtl, predicted)
    means, after = np.mean(predicted, axis=0), of_rtl.mean()
    counted = " | ".join(f"{value:,.0f}" for value in (*means, after))
    return f"| `{model}` | `{strategy}` | {counted} | {after / mhz / 1000:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--programs", type=Path)
    kept, arrival = parser.parse_args().programs, hw.chip(ON_ARRIVAL)
    for section, sizes, mhz in (
        ("answers", SIMULATED, 100.0),
        ("arrivals", arrival.open_core, 1000 * arrival.clock_ghz),
    ):
        rows = [row(model, strategy, kept, sizes, mhz) for model, strategy in MODELS]
        put_section(PAGE, section, "\n".join([HEAD.format(mhz=mhz), *filter(None, rows)]))


if __name__ == "__main__":
    main()
