"""Time a peer in its own environment: ``peer_worker.py TOOL JOB``, one line in for one line out.

The job is a file of ``Workload.write_job``. The worker builds the networks, plays the first recording and answers with its
spikes. Then each line of input names a mode and is answered with ``{"seconds": ...}``: seconds per recording of one turn,
without start-up and build. The line ``peak`` is answered with the most memory that the process has held, in MiB.

Each tool is a class with the same methods: ``spikes()`` of the first recording, and ``seconds(mode)`` of a turn.
"""

import json
import os
import sys
import time
import warnings
from importlib.metadata import version
from itertools import cycle
from pathlib import Path

import numpy as np
from peak_memory import peak_mib

sys.path.insert(0, str(Path(__file__).parents[1] / "peers"))


def read_job(path):
    """Return the networks of a job, with the arrays of the file put where the drivers expect them."""
    with np.load(path) as arrays:
        jobs = json.loads(str(arrays["jobs"]))
        for n, job in enumerate(jobs):
            job["recordings"] = arrays[f"{n}/recordings"]
            for k, projection in enumerate(job["projections"]):
                projection["weights"] = arrays[f"{n}/{k}"]
    return jobs


def timed(run):
    """Return how many seconds a call takes, and what it returns."""
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


class NengoLoihi:
    """The emulator; a fresh one for each recording, built before the clock starts."""

    package = "nengo-loihi"

    def __init__(self, network):
        self.network = network
        self.turns = cycle(network["recordings"])
        warnings.simplefilter("ignore")  # one for each overflow

    def emulator(self, spikes, probed=False):
        """Return an emulator that is about to play a recording, and its probes by population."""
        from drive_nengo_loihi import compartments, synapses
        from nengo_loihi.block import Axon
        from nengo_loihi.builder import Model
        from nengo_loihi.emulator import EmulatorInterface
        from nengo_loihi.inputs import SpikeInput
        from nengo_loihi.probe import LoihiProbe

        model, inputs = Model(), SpikeInput(spikes.shape[1])
        model.add_input(inputs)
        blocks = {
            population["name"]: compartments(population)
            for population in self.network["populations"]
        }
        for projection in self.network["projections"]:
            synapse = synapses(projection)
            blocks[projection["target"]].add_synapse(synapse)
            axon = Axon(synapse.n_axons)
            axon.target = synapse
            (inputs if projection["source"] == "x" else blocks[projection["source"]]).add_axon(axon)
        probes = {
            name: LoihiProbe(target=block, key="spiked") for name, block in blocks.items() if probed
        }
        for block in blocks.values():
            model.add_block(block)
        for probe in probes.values():
            model.add_probe(probe)
        emulator = EmulatorInterface(model, seed=0)
        for row, fired in enumerate(spikes):
            inputs.add_spikes(row + 1, np.flatnonzero(fired))  # its steps count from 1
        return emulator, probes

    def spikes(self):
        """Return the spikes of every population on the first recording."""
        recording = self.network["recordings"][0]
        emulator, probes = self.emulator(recording, probed=True)
        emulator.run_steps(len(recording))
        return {
            name: np.array(emulator.collect_probe_output(probe)) for name, probe in probes.items()
        }

    def seconds(self, mode):
        """Play one recording."""
        spikes = next(self.turns)
        emulator, _ = self.emulator(spikes)
        return timed(lambda: emulator.run_steps(len(spikes)))[0]


class Brian2Loihi:
    """A brian2 network, reset before each recording; its code is compiled (cython) before the clock starts."""

    package = "brian2-loihi"

    def __init__(self, network):
        from brian2 import prefs
        from brian2_loihi import LoihiNetwork, LoihiSpikeGeneratorGroup, LoihiSpikeMonitor
        from drive_brian2_loihi import neurons, synapses

        prefs.codegen.target = "cython"
        self.recordings = network["recordings"]
        self.turns = cycle(self.recordings)
        self.input = LoihiSpikeGeneratorGroup(
            self.recordings.shape[2], np.array([0]), np.array([0])
        )
        groups = {"x": self.input, **{p["name"]: neurons(p) for p in network["populations"]}}
        parts = list(groups.values())
        for projection in network["projections"]:
            parts += synapses(
                projection, groups[projection["source"]], groups[projection["target"]]
            )
        del groups["x"]
        self.monitors = {name: LoihiSpikeMonitor(group) for name, group in groups.items()}
        self.sizes = {name: len(group) for name, group in groups.items()}
        self.network = LoihiNetwork(*parts, *self.monitors.values())
        self.network.store()

    def play(self, spikes):
        """Return the seconds that a recording takes."""
        from brian2 import ms

        self.network.restore()
        rows, lines = np.nonzero(spikes)
        self.input.set_spikes(lines, (rows + 1) * ms)  # a spike acts in the row it is given
        return timed(lambda: self.network.run(len(spikes)))[0]

    def spikes(self):
        """Return the spikes of every population on the first recording."""
        self.play(self.recordings[0])
        found = {}
        for name, monitor in self.monitors.items():
            found[name] = np.zeros((self.recordings.shape[1], self.sizes[name]))
            found[name][np.rint(monitor.t_ * 1000).astype(int), np.array(monitor.i)] = 1
        return found

    def seconds(self, mode):
        """Play one recording."""
        return self.play(next(self.turns))


class LavaDl:
    """Dense synapses and CUBA neurons of slayer on all steps of a batch at once; torch takes all cores."""

    package = "lava-dl"

    def __init__(self, network):
        import torch
        from drive_lava_dl import neuron_of, synapse_of

        self.torch = torch
        torch.set_num_threads(os.cpu_count())
        torch.set_grad_enabled(False)
        self.names = [population["name"] for population in network["populations"]]
        self.layers = []
        for population, projection in zip(
            network["populations"], network["projections"], strict=True
        ):
            neuron = neuron_of(population)
            neuron.persistent_state = False
            self.layers.append((synapse_of(projection, neuron), neuron))
        self.batch = torch.tensor(network["recordings"].transpose(0, 2, 1), dtype=torch.float32)

    def play(self, batch):
        """Return the spikes of every layer, (batch, n, steps): a row acts in the next."""
        found = []
        for synapse, neuron in self.layers:
            batch = neuron(synapse(self.torch.nn.functional.pad(batch, (1, 0))[..., :-1]))
            found.append(batch)
        return found

    def spikes(self):
        """Return the spikes of every population on the first recording."""
        return {
            name: out[0].numpy().T
            for name, out in zip(self.names, self.play(self.batch[:1]), strict=True)
        }

    def seconds(self, mode):
        """Play the whole batch, or in mode ``one recording`` its first recording."""
        batch = self.batch[:1] if mode == "one recording" else self.batch
        return timed(lambda: self.play(batch))[0] / len(batch)


class SanaFe:
    """A chip that is loaded once and given its recording before the clock starts; its modes are its timing models."""

    package = "sanafe"

    def __init__(self, network):
        import drive_sanafe

        self.driver = drive_sanafe
        self.populations = network["populations"]
        self.recordings = network["recordings"]
        self.turns = cycle(self.recordings)
        self.chip = drive_sanafe.load(network, log_spikes=True)

    def spikes(self):
        """Return the spikes of every population on the first recording."""
        recording = self.recordings[0]
        self.driver.feed(self.chip, recording)
        trace = self.chip.sim(len(recording), processing_threads=1, spike_trace=True)["spike_trace"]
        return {p["name"]: self.driver.raster(trace, p, len(recording)) for p in self.populations}

    def seconds(self, mode):
        """Play one recording with a timing model."""
        spikes = next(self.turns)
        self.driver.feed(self.chip, spikes)
        return timed(lambda: self.chip.sim(len(spikes), timing_model=mode, processing_threads=1))[0]


TOOLS = {tool.package: tool for tool in (NengoLoihi, Brian2Loihi, LavaDl, SanaFe)}


def serve(tool, networks, answers):
    """Build the networks, then answer the lines of standard input."""

    def answer(**values):
        print(json.dumps(values), file=answers, flush=True)

    parts = [tool(network) for network in networks]
    spikes = [
        {name: array.astype(int).tolist() for name, array in part.spikes().items()}
        for part in parts
    ]
    answer(version=version(tool.package), spikes=spikes)
    for line in sys.stdin:
        mode = line.strip()
        if mode == "peak":
            answer(mib=peak_mib())
        else:
            answer(seconds=sum(part.seconds(mode) for part in parts))


if __name__ == "__main__":
    clean = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a peer prints must not be taken for an answer
    serve(TOOLS[sys.argv[1]], read_job(sys.argv[2]), clean)
