"""How full a program makes each memory of the open core, compared with the words that are loaded into it."""

from collections import Counter
from pathlib import Path

import pytest

import hw_model as hw
from hw_model.rtl.device import on_core
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.memory_use import memory_uses
from hw_model.rtl.memory_words import hex_words
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower

MODELS = Path(__file__).parents[2] / "examples/models"
MEMORY_NUMBERS = {
    "source_lists": ("01",),
    "synapse_pairs": ("02",),
    "neuron_constants": ("03", "04"),
    "channel_visits": ("05",),
    "phase_settings": ("07",),
}
"""By memory, the first two hexadecimal digits of its lines in a load; constants lie in two memories."""


@pytest.fixture(scope="module")
def core() -> CoreProgram:
    network = load(MODELS / "objects-hybrid-loihi.pt")
    device = hw.chip("ecp5-25f")
    program = lower(network, device, 8, "dendrite").program
    return on_core(program, network.steps, device)


@pytest.mark.parametrize("memory", MEMORY_NUMBERS)
def test_the_words_in_use_are_those_that_are_loaded(core: CoreProgram, memory: str) -> None:
    lines = hex_words(core.load_words(core.sizes)).decode().split()
    loaded = Counter(line[:2] for line in lines)
    # The core looks one pair of synapses ahead of the end of a list.
    looked_ahead = 1 if memory == "synapse_pairs" else 0
    for number in MEMORY_NUMBERS[memory]:
        assert memory_uses(core)[memory].used_words == loaded[number] + looked_ahead


def test_a_charge_waits_in_every_slot_of_a_compartment(core: CoreProgram) -> None:
    # No synapse has a delay, so two slots take turns.
    slots = 2
    branches = 2
    compartments_of_neuron = 3
    neurons = 32 + 36  # hidden, and one per class
    use = memory_uses(core)["waiting_charges"]
    assert use.used_words == slots * branches * compartments_of_neuron * neurons
    # The device has 16 slots for 512 compartments, and 18 bits for a charge.
    assert (use.words, use.word_bits) == (16 * 512, 18)
