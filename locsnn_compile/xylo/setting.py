"""The only setting of the compiler for a Xylo, with the reasons why other values have no meaning.

If a user asks for another value, its reason becomes the error. For ``--strategy dendrite``, it is::

    strategy: it lays out SRM neurons, and xylo-audio3 has neurons that leak (got dendrite). Leave it out.
"""

from hw_model.arithmetic import xylo
from locsnn_compile.own_arithmetic.setting import OnlySetting
from locsnn_compile.settings import NATIVE, Setting

XYLO_SETTING = OnlySetting(
    setting=Setting(NATIVE, xylo.WEIGHT_BITS),
    reasons={
        "strategy": "it lays out SRM neurons, and {chip} has neurons that leak",
        "weight_bits": "weights of {chip} have one width",
        "split_weights": "{chip} has one synapse for a weight",
    },
    fixes={},  # every error advises to leave the value out
)
"""Strategy ``native`` maps each leaky neuron of the network to a neuron of the chip; the chip's weights have 8 bits."""
