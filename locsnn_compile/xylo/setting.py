"""The only setting of the compiler for a Xylo, with the reasons why other values have no meaning."""

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
    fixes={},
)
"""Strategy ``native`` maps each leaky neuron to one of the chip's, which leak, too; the chip's weights have 8 bits."""
