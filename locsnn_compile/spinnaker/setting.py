"""The only setting of the compiler for SpiNNaker, with the reasons why other values have no meaning.

If a user asks for another value, its reason becomes the error. For ``--strategy dendrite``, it is::

    strategy: it joins compartments, and a neuron of spinnaker1 is a single one (got dendrite). Use strategy reset.
"""

from locsnn_compile.own_arithmetic.setting import OnlySetting
from locsnn_compile.settings import Setting

SPINNAKER_SETTING = OnlySetting(
    setting=Setting(strategy="reset", weight_bits=8),
    reasons={
        "strategy": "it joins compartments, and a neuron of {chip} is a single one",
        "weight_bits": "weights for {chip} are rounded to one width",
        "split_weights": "weights for {chip} are rounded once",
    },
    fixes={"strategy": "Use strategy reset."},
)
"""Strategy ``reset`` makes a single compartment of each neuron, which is what a neuron of SpiNNaker is."""
