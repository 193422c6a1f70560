"""slayerPytorch's kernels, which end where they become small: compared with the full ones that the chip has.

slayerPytorch samples ``k / tau * exp(1 - k / tau)``, times a factor, and stops at the first step beyond tau whose value
is below 0.01: of the published neuron, 77 taps of the input kernel and 11 of the refractory one remain. Recursive
dendrites hold the whole tail, and a chip's delays (62 steps) could not cut it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.slayer.config import LoihiNeuron, SlayerConfig
from locsnn_compile.network.neurons import SrmAlpha, alpha_taps

_CLOSE = 1e-3


def cut(neuron: SrmAlpha | LoihiNeuron) -> SrmAlpha:
    """Return neurons whose kernels end where slayerPytorch ends them; others have none, an ``InputError``."""
    if not isinstance(neuron, SrmAlpha):
        raise InputError("kernels 'cut'", "LOIHI neurons have no kernels", fix="Leave the option out.")
    return neuron.cut()


def check_kernels(tensors: Mapping[str, Any], config: SlayerConfig, where: str) -> None:
    """Compare the kernels that a checkpoint holds with those of the description: they must be one model's."""
    neuron = config.neuron
    if not isinstance(neuron, SrmAlpha):
        return
    wanted = {
        "srmKernel": alpha_taps(neuron.tau_sr, 1.0),
        "refKernel": alpha_taps(neuron.tau_ref, -neuron.scale_ref * neuron.theta),
    }
    for key, values in tensors.items():
        name = key.rpartition(".")[2]
        if name not in wanted:
            continue
        held, made = values.reshape(-1), wanted[name]
        shared = min(len(held), len(made))
        scale = max(float(np.abs(made).max(initial=0)), 1e-9)
        if shared and np.abs(held[:shared] - made[:shared]).max() > _CLOSE * scale:
            raise InputError(
                f"{where}, entry {key!r}",
                "the kernel is not that of the config",
                measured=f"{np.abs(held[:shared] - made[:shared]).max():.3g} apart",
                fix="Give the YAML that this checkpoint was trained with.",
            )
