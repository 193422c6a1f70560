"""How long the answer takes after the last word of a recording: cycles of the RTL and the prediction, into docs/hardware.md.

    python tests/hardware/answers.py [--programs FOLDER]

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
from hw_model.rtl import cycles
from hw_model.rtl.cosimulation import ANSWER, PATIENCE, play_on_core
from hw_model.rtl.images import SIMULATED, CoreProgram
from hw_model.rtl.simulators import sources
from locsnn_compile.api import recordings_for

sys.path.insert(0, str(ROOT / "tests/benchmarks"))
from page_section import put_section

PAGE = ROOT / "docs/hardware.md"
CLOCKS_MHZ = (100,)
HEAD = f"""\
| model | strategy | step that is under way | phases that follow | readout | after the last word | {" | ".join(f"ms at {clock} MHz" for clock in CLOCKS_MHZ)} |
| --- | --- | ---: | ---: | ---: | ---: |{" ---: |" * len(CLOCKS_MHZ)}"""


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


def row(model: str, strategy: str, kept: Path | None) -> str:
    network = lc.load(model_file(model))
    program = program_of(model, strategy, network, kept)
    recordings = recordings_for(network, example_files(model)[0])
    spikes = network.fit(recordings.spikes, recordings.source)
    found = hw.simulate(program, spikes, probe=("spikes",))
    core = CoreProgram(program, spikes.shape[1], None)
    predicted = [
        parts(core, one, {name: its[index] for name, its in found.spikes.items()}) for index, one in enumerate(spikes)
    ]
    answers = play_on_core(program, spikes, None, (), "verilator", timed_from_the_last_word(), SIMULATED, PATIENCE)[1]
    of_rtl = answers[:, ANSWER.index("cycles")]
    assert of_rtl.tolist() == [sum(one) for one in predicted], (of_rtl, predicted)
    means, after = np.mean(predicted, axis=0), of_rtl.mean()
    times = " | ".join(f"{after / clock / 1000:.2f}" for clock in CLOCKS_MHZ)
    return (
        f"| `{model}` | `{strategy}` | " + " | ".join(f"{mean:,.0f}" for mean in means) + f" | {after:,.0f} | {times} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=Path)
    kept = parser.parse_args().programs
    put_section(PAGE, "answers", "\n".join([HEAD, *(row(model, strategy, kept) for model, strategy in MODELS)]))


if __name__ == "__main__":
    main()
