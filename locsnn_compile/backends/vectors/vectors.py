"""``--emit vectors``: write memory images, stimuli and expected values for a test bench of the chip, core by core.

Somebody who designs such a chip can load a core with its images, play the stimuli, and compare spikes and registers in
every step. All files are text for Verilog's ``$readmemh``, one word per line; ``manifest.yaml`` defines every file and
every bit.
"""

import math
from collections.abc import Iterator

import numpy as np
import yaml

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import SIGN_MODES
from hw_model.description.chip import Chip
from hw_model.program.chip_program import Core
from hw_model.rtl.memory_words import BitArray, Layout, bits_for, bits_of, hex_words
from hw_model.values import Frozen, IntArray, picked
from locsnn_compile.backends.played import Played
from locsnn_compile.backends.vectors.synapse_image import synapse_image, synapse_layouts
from locsnn_compile.errors import check_most

FORMAT = "locsnn-vectors"
VERSION = 1
FOLDER = "vectors"
MAX_BYTES = 1 << 30
"""Most bytes of the files of registers, which may fill a disk, and of memory while words are packed; chosen by hand."""


class _Image(Frozen, eq=False):
    """A file of a core.

    - ``row``: what a row stands for, such as a step
    - ``bits``: the rows, (rows, bits of a word)
    - ``layout``: the name of the layout of a row, or else ``bit``: what each bit stands for
    """

    name: str
    row: str
    bits: BitArray
    layout: str = ""
    bit: str = ""

    def describe(self, file: str) -> dict[str, object]:
        """Return the entry of the file in the manifest."""
        entry: dict[str, object] = {"file": file, "rows": len(self.bits), "row": self.row}
        if self.layout:
            return entry | {"layout": self.layout}
        return entry | {"bit": self.bit, "width": self.bits.shape[1]}


def vectors_files(played: Played) -> dict[str, bytes]:
    """Return the content of every file by name, in the folder ``vectors``."""
    _check_size(played)
    program = played.program
    cores = []
    files = {}
    for core in program.cores:
        entries = {}
        for image in _images(core, played):
            name = f"core{core.number}/{image.name}.hex"
            files[name] = hex_words(image.bits)
            entries[image.name] = image.describe(name)
        cores.append(_core_entry(core, played, entries))
    layouts = {name: layout.describe() for name, layout in _layouts(program.chip).items()}
    phases = [
        {
            "name": phase.name,
            "axis": phase.axis,
            "first_step": played.runs[phase.name].start,
            "steps": played.steps(phase.name),
        }
        for phase in played.phases
    ]
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "program": program.name,
        "target": program.chip.name,
        "recording": played.title,
        "arithmetic": _arithmetic(program.chip),
        "layouts": layouts,
        "phases": phases,
        "cores": cores,
    }
    # With this flow style, lists and mappings of single values stand in one line.
    text = yaml.safe_dump(
        manifest, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None
    )
    files = {
        "manifest.yaml": text.encode(),
        "README.md": played.readme(__package__).encode(),
        **files,
    }
    return {f"{FOLDER}/{name}": content for name, content in files.items()}


def _images(core: Core, played: Played) -> Iterator[_Image]:
    """Yield the files of a core: its tables, then its stimuli, then the values to expect."""
    layouts = _layouts(played.program.chip)
    synapses = synapse_image(core, played.program.chip)
    yield _Image("axons", "input axon", synapses.axons, layout="axon")
    yield _Image("lists", "synapse list", synapses.lists, layout="list")
    yield _Image("synapses", "memory word", synapses.words, bit="bit of a word")
    yield _Image("formats", "synapse format", synapses.formats, layout="format")
    profiles = layouts["profile"].pack_rows([*map(vars, core.profiles)])
    yield _Image("profiles", "compartment profile", profiles, layout="profile")
    mantissas = layouts["threshold"].pack({"mantissa": np.array(core.thresholds, dtype=np.int64)})
    yield _Image("thresholds", "threshold", mantissas, layout="threshold")
    compartments = _compartments(core, layouts["compartment"])
    yield _Image("compartments", "compartment", compartments, layout="compartment")
    axons = core.axons
    outputs = layouts["output_axon"].pack(
        {"compartment": axons.out_compartment, "core": axons.out_core, "axon": axons.out_axon}
    )
    yield _Image("output_axons", "output axon", outputs, layout="output_axon")
    # Spikes from outside the chip, to test all cores together; then all that arrive, also from other cores, to test
    # one core alone.
    yield _Image("input_spikes", "step", played.input_axons(core), bit="input axon")
    yield _Image("axon_spikes", "step", played.axons(core), bit="input axon")
    yield _Image("spikes", "step", played.spikes(core), bit="compartment")
    (value_field,) = layouts["register"].fields
    for kind in ("u", "v"):
        words = bits_of(played.register(core, kind).ravel(), value_field)
        yield _Image(kind, "step * compartments + compartment", words, layout="register")


def _layouts(chip: Chip) -> dict[str, Layout]:
    """Return the layouts of all words with fields, as wide as the limits of the chip ask for.

    A field in quotation marks is signed.
    """
    limits = chip.limits
    registers = chip.registers
    compartment_bits = bits_for(limits.compartments_per_core - 1)
    decay_bits = bits_for(loihi.DECAYS.high)
    return {
        **synapse_layouts(chip),
        "profile": Layout.of(
            decay_u=decay_bits,
            decay_v=decay_bits,
            refractory=bits_for(registers.refractory_max),
            joined=1,  # 1 for a compartment that is joined to a parent, and never spikes
        ),
        "threshold": Layout.of(mantissa=registers.threshold_mantissa_bits),
        "compartment": Layout.of(
            "bias_mantissa",
            profile=bits_for(limits.compartment_profiles_per_core - 1),
            threshold=bits_for(limits.threshold_profiles_per_core - 1),
            bias_mantissa=registers.bias_mantissa_bits + 1,  # and its sign
            bias_exponent=bits_for(registers.bias_exponent_max),
            has_parent=1,
            parent=compartment_bits,
        ),
        "output_axon": Layout.of(
            compartment=compartment_bits,
            core=bits_for(chip.cores - 1),
            axon=bits_for(limits.input_axons_per_core - 1),
        ),
        # u and v share a layout, which has a bit more for the sign.
        "register": Layout.of(
            "value", value=max(registers.current_bits, registers.voltage_bits) + 1
        ),
    }


def _compartments(core: Core, layout: Layout) -> BitArray:
    """Return the table of compartments; ``parent`` is 0 where ``has_parent`` is."""
    has_parent: IntArray = (core.parent >= 0).astype(np.int64)
    return layout.pack(
        {
            "profile": core.profile,
            "threshold": core.threshold,
            "bias_mantissa": core.bias_mantissa,
            "bias_exponent": core.bias_exponent,
            "has_parent": has_parent,
            "parent": core.parent * has_parent,
        }
    )


def _core_entry(
    core: Core, played: Played, files: dict[str, dict[str, object]]
) -> dict[str, object]:
    """Return the entry of a core in the manifest."""
    slices = [picked(core_slice, "group", "start", "stop", "offset") for core_slice in core.slices]
    return {
        **picked(core, "number", "slot", "phase"),
        "steps": played.steps(core.phase),
        "compartments": core.compartments,
        "input_axons": core.axons.input_axons,
        **picked(core, "vmin", "vmax"),
        "slices": slices,
        "files": files,
    }


def _arithmetic(chip: Chip) -> dict[str, object]:
    """Return the numbers of the chip that a test bench needs to compute a step."""
    registers = chip.registers
    memory = chip.synapse_memory
    return {
        **picked(registers, "charge_bits", "current_bits"),
        **loihi.BITS_OF_UNITS,
        "delay_max": registers.delay_max,
        "sign_modes": list(SIGN_MODES),
        "synapse": ["weight", "delay", "index"],
        **picked(memory, "word_bits", "run_length", "run_header_bits"),
    }


def _check_size(played: Played) -> None:
    """Raise InputError if the files would fill a disk: u and v are most of it, unless memory words are very wide."""
    chip = played.program.chip
    cores = played.program.cores
    register_values = sum(2 * core.compartments * played.steps(core.phase) for core in cores)
    # A line has the hexadecimal digits of a value, rounded up, and its end.
    bytes_per_line = math.ceil(_layouts(chip)["register"].width / 4) + 1
    check_most(
        register_values * bytes_per_line,
        MAX_BYTES,
        "--emit vectors",
        "u and v of every compartment and step would be too much",
        unit="bytes",
        fix="Emit a shorter recording.",
    )
    # Packing takes a byte per bit of memory.
    memory_words = sum(core.axons.synapse_words for core in cores)
    check_most(
        memory_words * chip.synapse_memory.word_bits,
        MAX_BYTES,
        "--emit vectors",
        "the words of the synapse memory would be too much",
        unit="bytes",
        fix="Leave out --emit vectors.",
    )
