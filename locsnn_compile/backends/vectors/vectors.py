"""``--emit vectors``: memory images, stimuli and expected values for a test bench of the chip, core by core.

All files are text for ``$readmemh``, one word per line; ``manifest.yaml`` defines every file and every bit.
"""

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

FORMAT, VERSION = "locsnn-vectors", 1
FOLDER = "vectors"
MAX_BYTES = 1 << 30
"""Most bytes of the files of registers, which may fill a disk, and of memory while words are packed."""


class _Image(Frozen, eq=False):
    """A file of a core: its words as bits, what a row is, and the layout of a row or else what each bit is."""

    name: str
    row: str
    bits: BitArray
    layout: str = ""
    bit: str = ""

    def describe(self, file: str) -> dict[str, object]:
        """Return the entry of the file in the manifest."""
        kind = (
            {"layout": self.layout}
            if self.layout
            else {"bit": self.bit, "width": self.bits.shape[1]}
        )
        return {"file": file, "rows": len(self.bits), "row": self.row, **kind}


def vectors_files(played: Played) -> dict[str, bytes]:
    """Return every file by name, in the folder ``vectors``."""
    _check_size(played)
    program = played.program
    cores, files = [], {}
    for core in program.cores:
        entries = {}
        for image in _images(core, played):
            name = f"core{core.number}/{image.name}.hex"
            files[name] = hex_words(image.bits)
            entries[image.name] = image.describe(name)
        cores.append(_core_entry(core, played, entries))
    layouts = {name: layout.describe() for name, layout in _layouts(program.chip).items()}
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "program": program.name,
        "target": program.chip.name,
        "recording": played.title,
        "arithmetic": _arithmetic(program.chip),
        "layouts": layouts,
        "phases": [
            {
                "name": name,
                "axis": axis,
                "first_step": played.runs[name].start,
                "steps": played.steps(name),
            }
            for name, axis in ((phase.name, phase.axis) for phase in played.phases)
        ],
        "cores": cores,
    }
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
    layouts, synapses = _layouts(played.program.chip), synapse_image(core, played.program.chip)
    yield _Image("axons", "input axon", synapses.axons, layout="axon")
    yield _Image("lists", "synapse list", synapses.lists, layout="list")
    yield _Image("synapses", "memory word", synapses.words, bit="bit of a word")
    yield _Image("formats", "synapse format", synapses.formats, layout="format")
    yield _Image(
        "profiles",
        "compartment profile",
        layouts["profile"].pack_rows([*map(vars, core.profiles)]),
        layout="profile",
    )
    axons = core.axons
    outputs = {"compartment": axons.out_compartment, "core": axons.out_core, "axon": axons.out_axon}
    mantissas = layouts["threshold"].pack({"mantissa": np.array(core.thresholds, dtype=np.int64)})
    yield _Image("thresholds", "threshold", mantissas, layout="threshold")
    yield _Image(
        "compartments",
        "compartment",
        _compartments(core, layouts["compartment"]),
        layout="compartment",
    )
    yield _Image(
        "output_axons", "output axon", layouts["output_axon"].pack(outputs), layout="output_axon"
    )
    # Those that come from outside, then all that arrive, from other cores too.
    yield _Image("input_spikes", "step", played.input_axons(core), bit="input axon")
    yield _Image("axon_spikes", "step", played.axons(core), bit="input axon")
    yield _Image("spikes", "step", played.spikes(core), bit="compartment")
    (value,) = layouts["register"].fields
    for kind in ("u", "v"):
        words = bits_of(played.register(core, kind).ravel(), value)
        yield _Image(kind, "step * compartments + compartment", words, layout="register")


def _layouts(chip: Chip) -> dict[str, Layout]:
    """Return the layouts of all words with fields."""
    limits, registers = chip.limits, chip.registers
    compartment, decay = bits_for(limits.compartments_per_core - 1), bits_for(loihi.DECAYS.high)
    return {
        **synapse_layouts(chip),
        "profile": Layout.of(
            decay_u=decay,
            decay_v=decay,
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
            parent=compartment,
        ),
        "output_axon": Layout.of(
            compartment=compartment,
            core=bits_for(chip.cores - 1),
            axon=bits_for(limits.input_axons_per_core - 1),
        ),
        "register": Layout.of(
            "value", value=max(registers.current_bits, registers.voltage_bits) + 1
        ),
    }


def _compartments(core: Core, layout: Layout) -> BitArray:
    has_parent: IntArray = (core.parent >= 0).astype(np.int64)
    fields = {field.name: getattr(core, field.name, has_parent) for field in layout.fields}
    return layout.pack({**fields, "parent": core.parent * has_parent})


def _core_entry(
    core: Core, played: Played, files: dict[str, dict[str, object]]
) -> dict[str, object]:
    return {
        **picked(core, "number", "slot", "phase"),
        "steps": played.steps(core.phase),
        "compartments": core.compartments,
        "input_axons": core.axons.input_axons,
        **picked(core, "vmin", "vmax"),
        "slices": [picked(piece, "group", "start", "stop", "offset") for piece in core.slices],
        "files": files,
    }


def _arithmetic(chip: Chip) -> dict[str, object]:
    """Return the numbers needed for the arithmetic of a step."""
    registers, memory = chip.registers, chip.synapse_memory
    return {
        **picked(registers, "charge_bits", "current_bits"),
        **loihi.BITS_OF_UNITS,
        "delay_max": registers.delay_max,
        "sign_modes": list(SIGN_MODES),
        "synapse": ["weight", "delay", "index"],
        **picked(memory, "word_bits", "run_length", "run_header_bits"),
    }


def _check_size(played: Played) -> None:
    """Refuse what would fill a disk: u and v are most of it, unless the words of the memory are very wide."""
    chip, cores = played.program.chip, played.program.cores
    values = sum(2 * core.compartments * played.steps(core.phase) for core in cores)
    # Hexadecimal digits, rounded up, and the end of a line.
    line = -(-_layouts(chip)["register"].width // 4) + 1
    # Packing takes a byte per bit of memory.
    bits = sum(core.axons.synapse_words for core in cores) * chip.synapse_memory.word_bits
    for what, size, fix in (
        ("u and v of every compartment and step", values * line, "Emit a shorter recording."),
        ("the words of the synapse memory", bits, "Leave out --emit vectors."),
    ):
        check_most(
            size, MAX_BYTES, "--emit vectors", f"{what} would be too much", unit="bytes", fix=fix
        )
