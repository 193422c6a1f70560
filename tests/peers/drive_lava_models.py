"""Play emitted folders in Lava's fixed-point models, in one process: ``drive_lava_models.py SCRIPT FOLDERS RESULT``.

Lava starts an operating-system process for each of its processes, which takes seconds. Here its models, the classes that
compute, take turns in the order of ``tests/support/lava_stand_in.py``, so that a thousand programs take minutes.
``drive_lava.py`` plays programs in Lava as a whole.
"""

import sys
from pathlib import Path

import drive_lava
import numpy as np
from lava.proc.dense.models import PyDelayDenseModelBitAcc, PyDenseModelBitAcc
from lava.proc.lif.models import PyLifModelBitAcc
from lava.utils.weightutils import SignMode

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
import lava_stand_in as stand_in

SCRIPT_AT = drive_lava.script_at


class Wire:
    """Both ends of a message: what is sent is what is received."""

    def __init__(self):
        self.value = None

    def send(self, value):
        self.value = value

    def recv(self):
        return self.value


class LIF(stand_in.LIF):
    """Neurons of the stand-in that Lava's model updates."""

    def __init__(self, *, shape, du, dv, vth, bias_mant, bias_exp):
        super().__init__(shape=shape, du=du, dv=dv, vth=vth, bias_mant=bias_mant, bias_exp=bias_exp)
        model = PyLifModelBitAcc({})
        model.u = np.zeros(shape, dtype=np.int32)
        model.v = np.zeros(shape, dtype=np.int32)
        model.du = np.array([du], dtype=np.uint16)
        model.dv = np.array([dv], dtype=np.uint16)
        model.vth = np.array([vth], dtype=np.int32)
        model.bias_mant = bias_mant.astype(np.int16)
        model.bias_exp = bias_exp.astype(np.int16)
        model.a_in = Wire()
        model.s_out = Wire()
        self.model = model

    def update(self, step):
        del step
        arriving = np.zeros(self.model.u.shape, dtype=np.int32)
        for dense in self.a_in.partners:
            arriving = arriving + dense.arriving()
        self.model.a_in.value = arriving
        self.model.run_spk()
        self.spikes = self.model.s_out.value.astype(int)
        self.u.value = self.model.u
        self.v.value = self.model.v


class Dense(stand_in.DelayDense):
    """Synapses of the stand-in whose sums Lava's model computes; ``delays`` is None for synapses without delay."""

    def __init__(self, *, weights, delays=None, **settings):
        super().__init__(weights=weights, delays=0, **settings)
        size = len(weights)
        if delays is None:
            model = PyDenseModelBitAcc(settings)
            model.a_buff = np.zeros(size, dtype=np.int32)
        else:
            model = PyDelayDenseModelBitAcc(settings)
            model.a_buff = np.zeros((size, int(delays.max()) + 1), dtype=np.int32)
            model.delays = delays.astype(np.int32)
        model.weights = weights.astype(np.int32)
        model.num_message_bits = np.array([0])
        model.s_in = Wire()
        model.a_out = Wire()
        self.model = model

    def arriving(self):
        """Return the charges that the model sends in the next step."""
        buffered_charges = self.model.a_buff
        return buffered_charges if buffered_charges.ndim == 1 else buffered_charges[:, 0]

    def put_off(self, step, spikes):
        del step
        self.model.s_in.value = spikes
        self.model.run_spk()


def with_models(path):
    """Import the emitted script, with these classes in the place of Lava's processes."""
    script = SCRIPT_AT(path)
    script.LIF = LIF
    script.Dense = Dense
    script.DelayDense = Dense
    script.Source = stand_in.Source
    script.Sink = stand_in.Sink
    script.RunSteps = stand_in.RunSteps
    script.Loihi2SimCfg = stand_in.Loihi2SimCfg
    script.SIGN_MODES = {mode.name.lower(): mode for mode in SignMode}
    return script


if __name__ == "__main__":
    drive_lava.script_at = with_models
    drive_lava.main()
