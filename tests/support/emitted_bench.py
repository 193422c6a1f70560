"""A test bench of the chip that knows ``manifest.yaml``, the hexadecimal files, and the arithmetic; nothing of the project.

It reads the standard library and PyYAML only: what it finds comes from the memory images alone.
"""

from __future__ import annotations

from pathlib import Path

import yaml


class Vectors:
    """Files of a folder, decoded as the manifest says."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.manifest = yaml.safe_load((self.folder / "manifest.yaml").read_text())

    def words(self, entry):
        """Return the words of a file as integers."""
        found = [int(line, 16) for line in (self.folder / entry["file"]).read_text().splitlines()]
        assert len(found) == entry["rows"]
        return found

    def rows(self, entry):
        """Return the words of a file as dictionaries of fields, or as lists of bits."""
        if "layout" in entry:
            return [self.fields(word, entry["layout"]) for word in self.words(entry)]
        return [[word >> i & 1 for i in range(entry["width"])] for word in self.words(entry)]

    def fields(self, word, layout):
        """Return the fields of a word."""
        described = self.manifest["layouts"][layout]
        assert word < 1 << described["width"]
        return {
            field["name"]: bits(word, field["low"], field["width"], field["signed"])
            for field in described["fields"]
        }


def bits(word, low, width, signed=False):
    value = word >> low & (1 << width) - 1
    return value - (1 << width) if signed and value >> width - 1 else value


def wrap(x, width):
    """Two's complement of ``width`` bits plus sign."""
    return bits(x, 0, width + 1, signed=True)


def decay(x, d, decay_bits):
    kept = abs(x) * ((1 << decay_bits) - d) >> decay_bits
    return kept if x >= 0 else -kept


class CoreBench:
    """One core, loaded from its images; rows are steps."""

    def __init__(self, vectors, entry):
        self.entry, self.arithmetic = entry, vectors.manifest["arithmetic"]
        self.tables = {
            name: vectors.rows(file) for name, file in entry["files"].items() if name != "synapses"
        }
        self.memory = vectors.words(entry["files"]["synapses"])
        self.header = vectors.manifest["layouts"]["run_header"]["fields"]
        self.lists = [self._read_list(item) for item in self.tables["lists"]]
        n = entry["compartments"]
        self.u, self.v, self.blocked = [0] * n, [0] * n, [0] * n
        self.due = {}

    def _read_list(self, item):
        """Walk the runs of a list; return its synapses (target, weight, delay)."""
        a, found = self.arithmetic, []
        at, end = item["first_word"], item["first_word"] + item["words"]
        while at < end:
            head = {f["name"]: bits(self.memory[at], f["low"], f["width"]) for f in self.header}
            form, count = self.tables["formats"][head["format"]], head["synapses_less_1"] + 1
            widths = [form["weight_bits"], form["delay_bits"], form["index_bits"]]
            words = -(-(a["run_header_bits"] + count * sum(widths)) // a["word_bits"])
            run = sum(
                word << a["word_bits"] * i for i, word in enumerate(self.memory[at : at + words])
            )
            low = a["run_header_bits"]
            for _ in range(count):
                stored, delay, index = self._read_synapse(run, low, widths, form)
                target = index if form["index_bits"] else item["base"] + len(found)
                found.append((target, self._weight(stored, form), delay))
                low += sum(widths)
            assert run >> low == 0
            at += words
        assert at == end
        return found

    def _read_synapse(self, run, low, widths, form):
        values = []
        for name, width in zip(self.arithmetic["synapse"], widths, strict=True):
            signed = (
                name == "weight" and self.arithmetic["sign_modes"][form["sign_mode"]] == "mixed"
            )
            values.append(bits(run, low, width, signed))
            low += width
        return values

    def _weight(self, stored, form):
        mode = self.arithmetic["sign_modes"][form["sign_mode"]]
        step = 1 << (9 if mode == "mixed" else 8) - form["weight_bits"]
        mantissa = -stored * step if mode == "inhibitory" else stored * step
        exponent = form["exponent"]
        scaled = mantissa << exponent if exponent >= 0 else mantissa >> -exponent
        return scaled << self.arithmetic["weight_shift"]

    def deliver(self, axon, step):
        item = self.tables["axons"][axon]
        for synapses in self.lists[item["first_list"] : item["first_list"] + item["lists"]]:
            for target, weight, delay in synapses:
                assert delay <= self.arithmetic["delay_max"]
                key = (step + 1 + delay, target)
                self.due[key] = self.due.get(key, 0) + weight

    def update(self, step):
        """Return spikes, u and v of every compartment after a step."""
        a, spikes = self.arithmetic, []
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
                v, self.blocked[i] = 0, self.blocked[i] - 1
                fired = False
            else:
                mantissa = self.tables["thresholds"][row["threshold"]]["mantissa"]
                fired = not profile["joined"] and v > mantissa << a["weight_shift"]
            if fired:
                v, self.blocked[i] = 0, profile["refractory"] - 1
            self.v[i] = v
            if row["has_parent"]:
                assert row["parent"] > i
                joined[row["parent"]] += v
            spikes.append(int(fired))
        return spikes, list(self.u), list(self.v)


def run_core(vectors, entry):
    """Play ``axon_spikes`` to one core alone; return spikes, u and v by step."""
    core, found = CoreBench(vectors, entry), []
    for step, axons in enumerate(core.tables["axon_spikes"]):
        found.append(core.update(step))
        for axon, spike in enumerate(axons):
            if spike:
                core.deliver(axon, step)
    return found


def run_cores(vectors, entries):
    """Play ``input_spikes`` to the cores of a phase together, spikes travelling by the output axons."""
    cores = {entry["number"]: CoreBench(vectors, entry) for entry in entries}
    found = {number: [] for number in cores}
    for step in range(entries[0]["steps"]):
        for number, core in cores.items():
            found[number].append(core.update(step))
        for number, core in cores.items():
            for axon, spike in enumerate(core.tables["input_spikes"][step]):
                if spike:
                    core.deliver(axon, step)
            spikes = found[number][step][0]
            for row in core.tables["output_axons"]:
                if spikes[row["compartment"]]:
                    cores[row["core"]].deliver(row["axon"], step)
    return found


def expected(vectors, entry):
    """Return spikes, u and v by step as the files hold them."""
    n, tables = (
        entry["compartments"],
        {name: vectors.rows(entry["files"][name]) for name in ("spikes", "u", "v")},
    )

    def row(name, step):
        return [word["value"] for word in tables[name][step * n : step * n + n]]

    return [
        (tables["spikes"][step], row("u", step), row("v", step)) for step in range(entry["steps"])
    ]
