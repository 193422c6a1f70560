"""The float reference: a Network evaluated in float64 with numpy alone, spike by spike."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.trace import ByteArray
from locsnn_compile.network import FloatArray, Network, SrmAlpha


@dataclass(frozen=True, eq=False)
class ReferenceResult:
    """``spikes[name]`` (batch, steps, n) for views and populations; ``potential[name]`` likewise, if asked for."""

    spikes: dict[str, ByteArray]
    potential: dict[str, FloatArray]
    scores: FloatArray
    """Class scores (batch, classes)."""

    @property
    def prediction(self) -> npt.NDArray[np.int64]:
        """Class with the highest score, the first of equals, (batch,)."""
        return np.asarray(self.scores.argmax(axis=1), dtype=np.int64)


def evaluate(network: Network, recordings: ByteArray, *, potentials: bool = False) -> ReferenceResult:
    """Evaluate recordings (batch, steps, channels), of the network's own steps and channels."""
    spikes: dict[str, ByteArray] = {view.name: view.play(recordings) for view in network.views}
    potential: dict[str, FloatArray] = {}
    for population in network.populations:
        drive = np.zeros((len(recordings), network.steps_of(population.axis), population.size))
        for projection in network.into(population.name):
            rows = spikes[projection.source].reshape(-1, projection.weights.shape[1])
            drive += (rows.astype(np.float64) @ projection.weights.T).reshape(drive.shape)
        spikes[population.name], u = srm_response(drive, population.neuron)
        if potentials:
            potential[population.name] = u
    readout = network.readout
    scores = sum(
        (
            w * spikes[name].sum(axis=1, dtype=np.float64)
            for name, w in zip(readout.populations, readout.weights, strict=True)
        ),
        start=np.zeros((len(recordings), network.classes)),
    )
    return ReferenceResult(spikes, potential, scores)


def srm_response(drive: FloatArray, neuron: SrmAlpha) -> tuple[ByteArray, FloatArray]:
    """Return spikes and potentials (batch, steps, n) of weighted input spikes (batch, steps, n).

    Both kernels in recursive form, with their full tails: c * k * a^(k-1) is the answer of two first-order filters of
    decay a in a row to a spike one step earlier, times c = e * a / tau.
    """
    a, refractory_a = math.exp(-1.0 / neuron.tau_sr), math.exp(-1.0 / neuron.tau_ref)
    gain = math.e * a / neuron.tau_sr
    refractory_gain = -neuron.scale_ref * neuron.theta * math.e * refractory_a / neuron.tau_ref
    batch, steps, n = drive.shape
    current, response, refractory_current, refractory = np.zeros((4, batch, n))
    spikes = np.zeros(drive.shape, dtype=np.uint8)
    potentials = np.empty(drive.shape)
    for step in range(steps):
        potentials[:, step] = gain * response + refractory_gain * refractory
        fired = potentials[:, step] >= neuron.theta
        spikes[:, step] = fired
        current = a * current + drive[:, step]
        response = a * response + current
        refractory_current = refractory_a * refractory_current + fired
        refractory = refractory_a * refractory + refractory_current
    return spikes, potentials
