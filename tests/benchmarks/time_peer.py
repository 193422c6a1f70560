"""Time a peer on one network: ``time_peer.py nengo-loihi|lava-dl JOB``, in the peer's own environment.

The job is a network as in ``tests/peers``, with ``recordings`` in place of ``spikes``. Prints seconds a recording, without
start-up and build: the median over single recordings, for lava-dl of whole batches.
"""

import json
import statistics
import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "peers"))


def nengo_loihi(job):
    from drive_nengo_loihi import compartments, synapses
    from nengo_loihi.block import Axon
    from nengo_loihi.builder import Model
    from nengo_loihi.emulator import EmulatorInterface
    from nengo_loihi.inputs import SpikeInput

    warnings.simplefilter("ignore")
    seconds = []
    for spikes in np.array(job["recordings"][:4]):
        model, inputs = Model(), SpikeInput(spikes.shape[1])
        model.add_input(inputs)
        blocks = {population["name"]: compartments(population) for population in job["populations"]}
        for projection in job["projections"]:
            synapse = synapses(projection)
            blocks[projection["target"]].add_synapse(synapse)
            axon = Axon(synapse.n_axons)
            axon.target = synapse
            (inputs if projection["source"] == "x" else blocks[projection["source"]]).add_axon(axon)
        for block in blocks.values():
            model.add_block(block)
        emulator = EmulatorInterface(model, seed=0)
        for row, fired in enumerate(spikes):
            inputs.add_spikes(row + 1, np.flatnonzero(fired))
        start = time.perf_counter()
        emulator.run_steps(len(spikes))
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def lava_dl(job):
    import torch
    from drive_lava_dl import neuron_of, synapse_of

    torch.set_num_threads(2)
    layers = []
    for population, projection in zip(job["populations"], job["projections"], strict=True):
        neuron = neuron_of(population)
        neuron.persistent_state = False
        layers.append((synapse_of(projection, neuron), neuron))
    batch = torch.tensor(np.array(job["recordings"][:32]).transpose(0, 2, 1), dtype=torch.float32)
    seconds = []
    with torch.no_grad():
        for _ in range(5):
            start = time.perf_counter()
            x = batch
            for synapse, neuron in layers:
                x = torch.nn.functional.pad(neuron(synapse(x)), (1, 0))[..., :-1]
            seconds.append((time.perf_counter() - start) / len(batch))
    return statistics.median(seconds)


if __name__ == "__main__":
    network = json.loads(Path(sys.argv[2]).read_text())
    print({"nengo-loihi": nengo_loihi, "lava-dl": lava_dl}[sys.argv[1]](network))
