"""Run networks that ``--emit sanafe`` wrote: ``run_sanafe_files.py JOB RESULT``, in SANA-FE's environment.

The job, a JSON file, lists ``{folder, file, steps}``. The result has for each its counts, the energies of its parts in
joules, its spikes as (step, group, neuron), and the potentials of all neurons that log them, by group name, then neuron.
"""

import json
import sys
from pathlib import Path

import sanafe

COUNTS = ("neurons_fired", "neurons_updated", "packets_sent", "spikes")


def run(folder, file, steps):
    """Return counts, energies, spikes and potentials of one network file."""
    arch = sanafe.load_arch(Path(folder) / "arch.yaml")
    chip = sanafe.SpikingChip(arch)
    chip.load(sanafe.load_net(Path(folder) / file, arch))
    found = chip.sim(
        steps, processing_threads=1, spike_trace=True, potential_trace=True, perf_trace=True
    )
    return {
        "counts": {
            **{name: found[name] for name in COUNTS},
            "hops": sum(found["perf_trace"]["hops"]),
        },
        "energy_joules": dict(found["energy"]),
        "spikes": [
            (step, a.group_name, a.neuron_offset)
            for step, row in enumerate(found["spike_trace"])
            for a in row
        ],
        "potential": found["potential_trace"],
    }


if __name__ == "__main__":
    job = json.loads(Path(sys.argv[1]).read_text())
    Path(sys.argv[2]).write_text(json.dumps([run(**item) for item in job]))
