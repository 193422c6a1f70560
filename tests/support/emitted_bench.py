"""A simulator of a chip from its emitted memory images: ``manifest.yaml`` and hexadecimal files, nothing else.

It stands for another team's test bench: it imports only the standard library and PyYAML, so it shows that the images
and the manifest suffice to reproduce the expected spikes and registers.
"""

from __future__ import annotations

from pathlib import Path

import yaml


class Vectors:
    """The files of an emitted folder, decoded as the manifest describes them; an ``entry`` describes one file."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.manifest = yaml.safe_load((self.folder / "manifest.yaml").read_text())

    def words(self, entry):
        """Return the words of a file as integers."""
        lines = (self.folder / entry["file"]).read_text().splitlines()
        assert len(lines) == entry["rows"]
        return [int(line, 16) for line in lines]

    def rows(self, entry):
        """Return the words of a file as dictionaries of fields, or as lists of bits where no layout is given."""
        if "layout" in entry:
            return [self.fields(word, entry["layout"]) for word in self.words(entry)]
        return [[word >> i & 1 for i in range(entry["width"])] for word in self.words(entry)]

    def fields(self, word, layout):
        """Return the fields of a word by name."""
        description = self.manifest["layouts"][layout]
        assert word < 1 << description["width"]
        return {
            field["name"]: bits(word, field["low"], field["width"], field["signed"])
            for field in description["fields"]
        }


def bits(word, low, width, signed=False):
    """Return ``width`` bits of a word from bit ``low`` on, in two's complement if ``signed``."""
    value = word >> low & (1 << width) - 1
    is_negative = signed and value >> width - 1
    return value - (1 << width) if is_negative else value


def wrap(x, width):
    """Return what a register of ``width`` bits and a sign holds of x."""
    return bits(x, 0, width + 1, signed=True)


def decay(x, d, decay_bits):
    """Return x * (1 - d / 2^decay_bits), truncated toward zero."""
    magnitude = abs(x) * ((1 << decay_bits) - d) >> decay_bits
    return magnitude if x >= 0 else -magnitude


class CoreBench:
    """One core, loaded from its images.

    ``due[step, target]`` is the charge that arrives at a compartment in a step; ``blocked`` counts the refractory steps
    that remain. ``lists`` are the synapses of the axons: an axon has several lists in a row.
    """

    def __init__(self, vectors, entry):
        self.entry = entry
        self.arithmetic = vectors.manifest["arithmetic"]
        self.tables = {
            name: vectors.rows(file) for name, file in entry["files"].items() if name != "synapses"
        }
        self.memory = vectors.words(entry["files"]["synapses"])
        self.header = vectors.manifest["layouts"]["run_header"]["fields"]
        self.lists = [self._read_list(item) for item in self.tables["lists"]]
        n = entry["compartments"]
        self.u = [0] * n
        self.v = [0] * n
        self.blocked = [0] * n
        self.due = {}

    def _read_list(self, item):
        """Return the synapses (target, weight, delay) of a list.

        A list consists of runs: a header with a format and a number of synapses, then the synapses, packed without gaps
        and filled up to whole words.
        """
        a = self.arithmetic
        synapses = []
        start = item["first_word"]
        end = start + item["words"]
        while start < end:
            header = {
                field["name"]: bits(self.memory[start], field["low"], field["width"])
                for field in self.header
            }
            synapse_format = self.tables["formats"][header["format"]]
            count = header["synapses_less_1"] + 1
            widths = [synapse_format[f"{name}_bits"] for name in ("weight", "delay", "index")]
            run_bits = a["run_header_bits"] + count * sum(widths)
            words = -(-run_bits // a["word_bits"])
            # The run as one large integer, its first word lowest.
            run = 0
            for i, word in enumerate(self.memory[start : start + words]):
                run |= word << a["word_bits"] * i
            low = a["run_header_bits"]
            for _ in range(count):
                stored, delay, index = self._read_synapse(run, low, widths, synapse_format)
                # A format without index bits has consecutive targets from the base of the list on.
                has_index = synapse_format["index_bits"] > 0
                target = index if has_index else item["base"] + len(synapses)
                synapses.append((target, self._weight(stored, synapse_format), delay))
                low += sum(widths)
            assert run >> low == 0, "bits after the last synapse of a run"
            start += words
        assert start == end
        return synapses

    def _read_synapse(self, run, low, widths, synapse_format):
        """Return the stored weight, the delay and the index of the synapse at bit ``low`` of a run."""
        mode = self.arithmetic["sign_modes"][synapse_format["sign_mode"]]
        values = []
        for name, width in zip(self.arithmetic["synapse"], widths, strict=True):
            signed = name == "weight" and mode == "mixed"
            values.append(bits(run, low, width, signed))
            low += width
        return values

    def _weight(self, stored, synapse_format):
        """Return the charge of a spike: the stored weight on the grid of its format, shifted by its exponent."""
        mode = self.arithmetic["sign_modes"][synapse_format["sign_mode"]]
        step = 1 << (9 if mode == "mixed" else 8) - synapse_format["weight_bits"]
        mantissa = -stored * step if mode == "inhibitory" else stored * step
        exponent = synapse_format["exponent"]
        scaled = mantissa << exponent if exponent >= 0 else mantissa >> -exponent
        return scaled << self.arithmetic["weight_shift"]

    def deliver(self, axon, step):
        """Add the weights of an axon's synapses to the charges of the steps in which they act."""
        item = self.tables["axons"][axon]
        for synapses in self.lists[item["first_list"] : item["first_list"] + item["lists"]]:
            for target, weight, delay in synapses:
                assert delay <= self.arithmetic["delay_max"]
                key = (step + 1 + delay, target)
                self.due[key] = self.due.get(key, 0) + weight

    def update(self, step):
        """Update every compartment, children before their parents; return spikes, u and v after the step."""
        a = self.arithmetic
        spikes = []
        joined = [0] * self.entry["compartments"]
        for i, row in enumerate(self.tables["compartments"]):
            profile = self.tables["profiles"][row["profile"]]
            q = wrap(self.due.pop((step, i), 0), a["charge_bits"])
            self.u[i] = wrap(
                decay(self.u[i], profile["decay_u"], a["decay_bits"]) + q, a["current_bits"]
            )
            drive = wrap(
                self.u[i] + (row["bias_mantissa"] << row["bias_exponent"]), a["current_bits"]
            )
            v = decay(self.v[i], profile["decay_v"], a["decay_bits"]) + drive + joined[i]
            v = min(max(v, self.entry["vmin"]), self.entry["vmax"])
            if self.blocked[i]:
                v = 0
                self.blocked[i] -= 1
                fired = False
            else:
                mantissa = self.tables["thresholds"][row["threshold"]]["mantissa"]
                fired = not profile["joined"] and v > mantissa << a["weight_shift"]
            if fired:
                v = 0
                self.blocked[i] = profile["refractory"] - 1
            self.v[i] = v
            if row["has_parent"]:
                assert row["parent"] > i
                joined[row["parent"]] += v
            spikes.append(int(fired))
        return spikes, list(self.u), list(self.v)


def run_core(vectors, entry):
    """Play ``axon_spikes`` to one core alone; return spikes, u and v by step."""
    core = CoreBench(vectors, entry)
    states = []
    for step, axons in enumerate(core.tables["axon_spikes"]):
        states.append(core.update(step))
        for axon, spike in enumerate(axons):
            if spike:
                core.deliver(axon, step)
    return states


def run_cores(vectors, entries):
    """Play ``input_spikes`` to all cores of a phase, which send each other spikes by their output axons.

    Return spikes, u and v by step, for each core by its number.
    """
    cores = {entry["number"]: CoreBench(vectors, entry) for entry in entries}
    states = {number: [] for number in cores}
    for step in range(entries[0]["steps"]):
        for number, core in cores.items():
            states[number].append(core.update(step))
        for number, core in cores.items():
            for axon, spike in enumerate(core.tables["input_spikes"][step]):
                if spike:
                    core.deliver(axon, step)
            spikes, _, _ = states[number][step]
            for row in core.tables["output_axons"]:
                if spikes[row["compartment"]]:
                    cores[row["core"]].deliver(row["axon"], step)
    return states


def expected(vectors, entry):
    """Return spikes, u and v by step as the emitted files of expected results hold them."""
    n = entry["compartments"]
    tables = {name: vectors.rows(entry["files"][name]) for name in ("spikes", "u", "v")}

    def row(name, step):
        """Return a register of all compartments; its file has a line per step and compartment."""
        return [word["value"] for word in tables[name][step * n : step * n + n]]

    return [
        (tables["spikes"][step], row("u", step), row("v", step)) for step in range(entry["steps"])
    ]
