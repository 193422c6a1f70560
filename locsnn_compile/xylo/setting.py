"""The one setting of the compiler for a Xylo, and why there is no other."""

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
"""Neurons leak as the chip's do, and its weights have 8 bits."""
