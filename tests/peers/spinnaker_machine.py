"""The machine code that sPyNNaker 7.4.1 loads onto a core of SpiNNaker, one function at a time.

``IF_curr_exp.aplx`` is read out of an installed sPyNNaker, and never changed. Its functions are
found by their first instructions, run under unicorn, and given memory in the layout that they were
seen to use. Runs in an environment of its own.
"""

import hashlib
import importlib.util
import re
import struct
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from unicorn import UC_ARCH_ARM, UC_MODE_ARM, Uc, arm_const

SHA256 = "acd257c9da6fa23c8995a080aeadd591182716cc0f8b6f2b26a1fbbdc15bc556"
ANY_WORD = "........"
"""In a pattern: a word that holds an address."""


class Function(NamedTuple):
    """The first words of a function, and which of them loads the address of its variables."""

    pattern: str
    loads_variables: int | None = None


EXPONENTIAL = (
    f"{ANY_WORD} e1500002 {ANY_WORD} {ANY_WORD} e1500002 {ANY_WORD} e3a00000 e12fff1e "
    f"e3e00102 e12fff1e e92d4010 {ANY_WORD}"
)
"""Both exponentials begin with these words: they check whether their argument is within their range."""
FUNCTIONS = {
    "expk": Function(f"{EXPONENTIAL} e1a008a0 e1800781"),
    "expulr": Function(f"{EXPONENTIAL} e8bd8010"),
    "start": Function(
        f"e5903000 e92d4ff0 {ANY_WORD} e24dd01c e3530000 e58d000c e58d1004 e58d2010 e588304c", 2
    ),
    "process_row": Function(f"e92d4ff0 e1a06000 {ANY_WORD} e0067002 e0477001 e0077002 e5942044", 2),
    "receive": Function(f"{ANY_WORD} e92d4ff0 e5932078 e24dd014 e3520000 e58d2004 e58d000c", 0),
    "update": Function(f"e92d4ff0 {ANY_WORD} e24dd034 e59a200c e58d0020 e5923004 e3530001", 1),
}
"""The functions that are called, by our names: two exponentials; ``start`` computes the constants of neurons; ``process_row``
adds a row of synapses to the ring buffer of charges; ``receive`` takes the charges of a step out of it; ``update`` steps all
neurons."""
ARGUMENTS = tuple(getattr(arm_const, f"UC_ARM_REG_R{n}") for n in range(4))

CODE_BYTES = 0x10000
RETURN_ADDRESS = CODE_BYTES - 0x1000
DATA = 0x400000
DATA_BYTES = 0x80000
STACK = DATA + DATA_BYTES - 0x1000
ROOM = {
    "neurons": 0x2000,
    "synapses": 0x5000,
    "thresholds": 0x8000,
    "parameters": 0xA000,
    "shifts": 0x10000,
    "recording": 0x11000,
    "index_list": 0x12000,
    "spike_bits": 0x12400,
    "recorded": 0x13000,
    "row": 0x18000,
    "flag": 0x1C000,
    "ring": 0x20000,
}
"""Where our data lie, from ``DATA`` on; the program's own variables lie below the first of them. Distances are larger than any
data of the tests."""
WORDS_OF_NEURON = 8
WORDS_OF_SYNAPSE = 6
COLOURS = 15
"""The mask of the lowest bits of a key, the step in which the spike was sent: by them a row knows how late it is."""
ONE = 1 << 15
"""1.0 in s16.15, the fixed-point format of all parameters."""
NEVER = 0x7FFFFFFF
"""A step that does not come, at which a variable would next be recorded."""


def installed_file() -> Path:
    """Return the file of an installed sPyNNaker, which is not imported: it would want a configuration."""
    package = importlib.util.find_spec("spynnaker")
    assert package is not None
    assert package.submodule_search_locations is not None
    (folder,) = package.submodule_search_locations
    return Path(folder) / "pyNN" / "model_binaries" / "IF_curr_exp.aplx"


def read_checked(path: Path) -> bytes:
    """Return the content of the file. Raise ValueError if it is not the one of sPyNNaker 7.4.1."""
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if digest != SHA256:
        raise ValueError(f"{path.name}: its SHA-256 is {digest}, not that of sPyNNaker 7.4.1")
    return content


def sections(content: bytes) -> dict[int, bytes]:
    """Return what the loader copies to each address. The file begins with the loader's commands, four words each."""
    copies = {}
    for entry in range(0, len(content), 16):
        command, address, offset, size = struct.unpack_from("<4I", content, entry)
        if command == 2:  # copy, from an offset that counts from the entry itself
            copies[address] = content[entry + offset : entry + offset + size]
        elif command != 3:  # 3 clears memory
            break
    return copies


@cache  # every core has the same code
def place_of(code: bytes, name: str) -> int:
    """Return where a function begins. Raise LookupError unless its first words occur exactly once."""
    words = FUNCTIONS[name].pattern.split()
    parts = [
        b"[\x00-\xff]{4}" if word == ANY_WORD else re.escape(struct.pack("<I", int(word, 16)))
        for word in words
    ]
    pattern = re.compile(b"(?=" + b"".join(parts) + b")", re.DOTALL)
    places = [match.start() for match in pattern.finditer(code) if match.start() % 4 == 0]
    if len(places) != 1:
        raise LookupError(f"{name}: its pattern occurs {len(places)} times")
    return places[0]


class Machine:
    """A core's memory with the program in it, and calls of its functions.

    Functions of neurons must agree on where their variables are: a check that the right ones were found.
    """

    def __init__(self, content: bytes) -> None:
        self.emulator = Uc(UC_ARCH_ARM, UC_MODE_ARM)
        self.emulator.mem_map(0, CODE_BYTES)
        self.emulator.mem_map(DATA, DATA_BYTES)
        copies = sections(content)
        for address, copied in copies.items():
            self.emulator.mem_write(address, copied)
        code = copies[0]
        self.begins = {name: place_of(code, name) for name in FUNCTIONS}
        self.variables = {
            name: self._variables(code, name)
            for name, function in FUNCTIONS.items()
            if function.loads_variables is not None
        }
        shared = {self.variables[name] for name in ("start", "receive", "update")}
        if len(shared) != 1:
            raise LookupError("the functions of neurons have not the same variables")

    def _variables(self, code: bytes, name: str) -> int:
        """Return the address that an instruction of a function loads, from a word behind the function's code.

        The offset is in the lowest 12 bits of the instruction; an ARM counts it from two instructions further on.
        """
        place = self.begins[name] + 4 * FUNCTIONS[name].loads_variables
        (instruction,) = struct.unpack_from("<I", code, place)
        (address,) = struct.unpack_from("<I", code, place + 8 + (instruction & 0xFFF))
        return address

    def write(self, address: int, words) -> None:
        """Write words of 32 bits."""
        array = np.asarray(words, dtype=np.int64) & 0xFFFFFFFF
        self.emulator.mem_write(address, array.astype("<u4").tobytes())

    def read(self, address: int, count: int) -> np.ndarray:
        """Return words of 32 bits with their sign."""
        content = bytes(self.emulator.mem_read(address, 4 * count))
        return np.frombuffer(content, dtype="<i4").astype(np.int64)

    def call(self, name: str, *arguments: int) -> int:
        """Call a function with up to four arguments; return its result as an unsigned word."""
        for register, argument in zip(ARGUMENTS, arguments, strict=False):
            self.emulator.reg_write(register, argument & 0xFFFFFFFF)
        self.emulator.reg_write(arm_const.UC_ARM_REG_SP, STACK)
        self.write(STACK, [DATA + ROOM["flag"]])  # a fifth argument, of those that have one
        self.emulator.reg_write(arm_const.UC_ARM_REG_LR, RETURN_ADDRESS)
        self.emulator.emu_start(self.begins[name], RETURN_ADDRESS, count=50_000_000)
        return self.emulator.reg_read(ARGUMENTS[0])


class Core:
    """Neurons of a population on one core, played by the machine code.

    ``parameters``: arrays (n,) of s16.15 by the names of PyNN in lower case, and tau_syn (n, 2).
    """

    def __init__(self, machine: Machine, parameters, shifts, slots: int) -> None:
        self.machine = machine
        self.size = len(parameters["tau_m"])
        self.slots = slots
        self.index_bits = (self.size - 1).bit_length()
        self.slot_shift = self.index_bits + 1  # a bit for the receptor
        self.address = {name: DATA + offset for name, offset in ROOM.items()}
        ring_bytes = 2 * (slots << self.slot_shift)
        machine.emulator.mem_write(self.address["ring"], bytes(ring_bytes))
        self._give_neurons_their_room(shifts)
        self._give_rows_their_room()
        self._give_records_their_room()
        self._start(parameters)

    def _give_neurons_their_room(self, shifts) -> None:
        """Write the addresses and sizes of the neurons' data to the variables at which ``update`` was seen to read them."""
        variables = self.machine.variables["update"]
        room = [self.address[name] for name in ("neurons", "synapses", "thresholds")]
        self.machine.write(variables + 0x50, [*room, self.size])
        self.machine.write(variables + 0x64, [0])  # no current sources
        no_key = 0  # spikes are recorded, and not sent
        self.machine.write(variables + 0x70, [no_key, 1 << self.index_bits, len(shifts)])
        self.machine.write(variables + 0x7C, [COLOURS, self.address["shifts"]])
        self.machine.write(self.address["shifts"], shifts)

    def _give_rows_their_room(self) -> None:
        """Write the layout of the ring buffer to the variables at which ``process_row`` was seen to read it."""
        variables = self.machine.variables["process_row"]
        slot_mask = self.slots - 1
        entry_mask = (self.slots << self.slot_shift) - 1
        self.machine.write(variables + 0x0C, [self.slot_shift])
        self.machine.write(variables + 0x28, [slot_mask, slot_mask << self.slot_shift])
        self.machine.write(variables + 0x38, [entry_mask, self.address["ring"]])
        self.machine.write(variables + 0x40, [0] * 5)  # counts

    def _give_records_their_room(self) -> None:
        """Let the core record three variables, a word per neuron, the first of them V, and spikes, a bit per neuron."""
        recording = self.address["recording"]
        word_info, word_lists, word_indices, bit_info, bit_lists, bit_indices = (
            recording + 0x80 * part for part in range(6)
        )
        indices = np.arange(self.size, dtype="<u2")
        self.machine.emulator.mem_write(self.address["index_list"], indices.tobytes())
        recorded = [self.address["recorded"] + 0x800 * variable for variable in range(3)]
        self.machine.write(word_info, [0, NEVER, 0, 0, 0, 0] * 3)
        self.machine.write(word_lists, recorded)
        self.machine.write(word_indices, [self.address["index_list"]] * 3)
        self.machine.write(bit_info, [NEVER, 0, 0, 0, 0, 0])
        self.machine.write(bit_lists, [self.address["spike_bits"]])
        self.machine.write(bit_indices, [self.address["index_list"]])
        parts = [word_info, word_lists, word_indices, bit_info, bit_lists, bit_indices]
        self.machine.write(self.machine.variables["update"], parts)

    def _start(self, parameters) -> None:
        """Write parameters as sPyNNaker lays them out, and let the core compute its constants."""
        order = ("v_init", "v_rest", "c_m", "tau_m", "i_offset", "v_reset", "tau_refrac")
        zeros = np.zeros(self.size, dtype=np.int64)
        steps = np.full(self.size, ONE)
        neurons = np.column_stack([*(parameters[name] for name in order), zeros, steps])
        excitatory, inhibitory = parameters["tau_syn"].T
        synapses = np.column_stack([excitatory, zeros, inhibitory, zeros, steps])
        updates_a_step = [1]
        parts = [updates_a_step, neurons.ravel(), parameters["v_thresh"], synapses.ravel()]
        self.machine.write(self.address["parameters"], np.concatenate(parts))
        self.machine.call("start", self.address["parameters"], self.size, 0)

    def _neurons(self) -> np.ndarray:
        """Return V, V_rest, R, e, I_offset, refractory steps left, V_reset and T of each neuron."""
        words = self.machine.read(self.address["neurons"], WORDS_OF_NEURON * self.size)
        return words.reshape(self.size, WORDS_OF_NEURON)

    def _synapses(self) -> np.ndarray:
        """Return decay, initial share and current of each neuron and receptor."""
        words = self.machine.read(self.address["synapses"], WORDS_OF_SYNAPSE * self.size)
        return words.reshape(self.size, 2, 3)

    def constants(self) -> dict[str, np.ndarray]:
        """Return the constants that the core has computed for its neurons."""
        neurons = self._neurons()
        synapses = self._synapses() & 0xFFFFFFFF
        return {
            "resistance": neurons[:, 2],
            "membrane_decay": neurons[:, 3],
            "refractory_steps": neurons[:, 7],
            "synapse_decay": synapses[:, :, 0],
            "synapse_init": synapses[:, :, 1],
        }

    def registers(self) -> dict[str, np.ndarray]:
        """Return V, currents and refractory steps of every neuron."""
        neurons = self._neurons()
        currents = self._synapses()[:, :, 2]
        return {"v": neurons[:, 0], "current": currents, "refractory": neurons[:, 5]}

    def step(self, t: int) -> np.ndarray:
        """Play step t; return spikes (n,)."""
        words = (self.size + 31) // 32
        self.machine.write(self.address["spike_bits"], [0] * words)
        slot = (t % self.slots) << self.slot_shift
        self.machine.call("receive", self.address["ring"] + 2 * slot)
        self.machine.call("update", t, t)
        content = self.machine.emulator.mem_read(self.address["spike_bits"], 4 * words)
        bits = np.unpackbits(np.frombuffer(bytes(content), np.uint8), bitorder="little")
        return bits[: self.size]

    def recorded_v(self) -> np.ndarray:
        """Return V as the core recorded it in the last step."""
        return self.machine.read(self.address["recorded"], self.size)

    def process_row(self, t: int, lateness: int, synapses: np.ndarray) -> None:
        """Process synapses (neuron, receptor, weight, delay) of a source in step t."""
        neuron, receptor, weight, delay = synapses.T
        slot = (delay % self.slots) << self.slot_shift
        words = weight << 16 | slot | receptor << self.index_bits | neuron
        no_plastic = 0
        self.machine.write(self.address["row"], [no_plastic, len(words), 0, *words])
        sent = (t - lateness) & COLOURS
        self.machine.call("process_row", t, sent, COLOURS, self.address["row"])

    def counts(self) -> np.ndarray:
        """Return how many synapses came too late, and how many weights saturated."""
        return self.machine.read(self.machine.variables["process_row"] + 0x4C, 2)
