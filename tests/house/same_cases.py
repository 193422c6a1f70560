"""The commands that the byte comparison of `same_bytes.py` runs.

A case is a list of commands, each as a user types it, that run in a folder of the case's own. Their
inputs are those that `same_inputs.py` writes.
"""

from __future__ import annotations

IN = "../../inputs"
"""The folder of inputs, from the folder of a case."""
TOUCHES = f"{IN}/recordings/touches.npz"
LEVELS = "network quantized compartments placed routed program csv"
"""What `--emit` writes for every model: the levels of the compiler, and tables."""
BENCH = "vectors vcd trace sanafe graphml dot"
"""What `--emit` writes for a few models: test vectors, waveforms, and files for other tools."""
MODELS = ("containers-hybrid", "containers-hybrid-loihi", "objects-hybrid", "objects-hybrid-loihi")
FURTHER_MODELS = {
    "containers-best": "touches",
    "containers-window-16": "touches",
    "objects-best": "touches",
    "two-fingertips": "two-fingertips",
}
"""The other shipped models, each with shipped recordings that it takes."""
IN_LOGIC = {"objects-hybrid-loihi": "ecp5-25f", "containers-window-16": "ecp5-85f"}
"""Models that the open core holds, each with a board."""
SRM_MODELS = ("containers-hybrid", "objects-hybrid")
RECORDINGS = ("touches", "touches-long", "motions")
STRATEGIES = {"dendrite": 6, "delay-line": 8, "reset": 4, "paired-dendrite": 8}
"""For each strategy, the bits of a weight that it is tried with."""
NIR_FILES = ("two-layers", "biases", "conv2d", "avg-pool", "delay", "recurrent", "nested", "if")
NET_FILES = (
    "a-decay-each",
    "bias",
    "delay-of-a-neuron",
    "recurrent",
    "conv",
    "input-layer-with-neurons",
)
CODES = "exit_codes"
"""The file of a case that is written last."""


def shipped(model: str, recording: str, more: str = "", out: str = "out") -> str:
    """Return the command that compiles a shipped model on shipped recordings."""
    return (
        f"compile {IN}/models/{model}.pt --events {IN}/recordings/{recording}.npz -o {out} {more}"
    )


def _cases() -> dict[str, list[str]]:
    """Return the commands of every case, by its name."""
    small = "objects-hybrid-loihi"
    cases = {}
    for recording in RECORDINGS:
        for model in MODELS:
            emit = f"--emit {LEVELS} {BENCH if recording == 'touches' else ''}"
            cases[f"{model} {recording}"] = [shipped(model, recording, emit)]
    for model, recording in FURTHER_MODELS.items():
        cases[f"{model} {recording}"] = [shipped(model, recording, f"--emit {LEVELS}")]
    for model, board in IN_LOGIC.items():
        options = f"--target {board} --emit {LEVELS} rtl"
        cases[f"{model} rtl"] = [shipped(model, "touches", options)]
    for model in SRM_MODELS:
        for strategy, bits in STRATEGIES.items():
            options = (
                f"--strategy {strategy} --weight-bits {bits} --split-weights 0.25 --emit {LEVELS}"
            )
            cases[f"{model} {strategy}"] = [shipped(model, "touches", options)]
    for name in NIR_FILES:
        emit = f"--emit {LEVELS} nir {BENCH if name == 'two-layers' else ''}"
        cases[f"nir {name}"] = [
            f"compile {IN}/{name}.nir --dt 1e-3 --events {IN}/{name}-nir.npy -o out {emit}"
        ]
    for name in NET_FILES:
        cases[f"net {name}"] = [
            f"compile {IN}/{name}.net --events {IN}/{name}-net.npy -o out --emit {LEVELS} net"
        ]
    for name in ("srm", "loihi"):
        folder = f"{IN}/slayer-{name}"
        files = f"{folder}/model.pt --config {folder}/net.yaml --events {folder}/spikes.npy"
        cases[f"slayer {name}"] = [
            f"compile {files} -o out --emit {LEVELS}",
            f"compile {files} -o cut --kernels cut",
        ]
    cases["gates and another chip"] = [
        shipped(small, "touches", "--min-agreement 1 --max-energy-nj 1 --junit gates.xml --json"),
        shipped(small, "touches", "--target tiny-sim", out="tiny"),
        shipped(small, "touches", "--strategy dendrit", out="misspelt"),
    ]
    cases["what other tools cannot hold"] = [
        shipped(small, "touches", "--emit net"),
        shipped("objects-hybrid", "touches", "--emit nir"),
    ]
    cases["run and diff"] = [
        shipped(small, "touches"),
        shipped("containers-hybrid-loihi", "motions", "--weight-bits 6", out="other"),
        "locsnn diff out other --html diff.html",
        "locsnn diff out other --json",
        f"locsnn run out --events {TOUCHES}",
        f"locsnn run out --events {TOUCHES} --stop proven --json",
        f"locsnn run out --events {TOUCHES} --stop margin --calibrate {IN}/recordings/motions.npz",
    ]
    cases["events and targets"] = [
        f"locsnn events {TOUCHES} -o raster.svg",
        f"locsnn events {IN}/recordings/motions.npz --json --recording 3",
        f"locsnn events {TOUCHES} --to touches.zip --members bs1",
        "locsnn targets",
        "locsnn targets --show loihi-sim",
    ]
    grid = f"--events {TOUCHES} --recordings 6 --split-weights 0 1 --engines"
    cases["explore"] = [
        f"locsnn explore {IN}/models/{small}.pt -o out --weight-bits 3 6 --max-spike-error 0.05 {grid}",
        f"locsnn explore {IN}/models/objects-hybrid.pt -o srm --weight-bits 6 --strategy dendrite reset {grid} "
        f"--report-on {IN}/recordings/motions.npz",
    ]
    cases["stress"] = ["locsnn stress --quick -o stress.md", "locsnn stress --quick --json"]
    cases["help"] = [
        "compile --help",
        *(
            f"locsnn {name} --help"
            for name in ("train", "run", "events", "explore", "diff", "stress", "targets")
        ),
    ]
    return cases


CASES = _cases()
QUICK = (  # a case of each kind of input, and the help texts
    "objects-hybrid-loihi touches",
    "objects-hybrid dendrite",
    "objects-best touches",
    "containers-window-16 rtl",
    "nir two-layers",
    "net conv",
    "slayer srm",
    "help",
)
