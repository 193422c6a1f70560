"""slayerPytorch checkpoints and their YAML, as its modules save them; its forward pass in plain numpy."""

import numpy as np
import torch
import yaml

SMALLEST = 0.01
"""slayerPytorch ends a kernel at the first lag beyond tau whose magnitude is below this."""
SRM = {
    "type": "SRMALPHA",
    "theta": 10.0,
    "tauSr": 10.0,
    "tauRef": 1.0,
    "scaleRef": 2.0,
    "tauRho": 1,
    "scaleRho": 1,
}
LOIHI = {
    "type": "LOIHI",
    "vThMant": 400,
    "vDecay": 128,
    "iDecay": 1024,
    "refDelay": 1,
    "wgtExp": 0,
    "tauRho": 1,
    "scaleRho": 1,
}


def kernel(tau, factor):
    """slayerPytorch's _calculateAlphaKernel with a Ts of 1, for time constants whose kernels end within 1,000 steps."""
    taps = []
    for t in range(1000):
        value = factor * t / tau * np.exp(1 - t / tau)
        if abs(value) < SMALLEST and t > tau:
            break
        taps.append(value)
    return np.array(taps)


def write(folder, weights, neuron=SRM, steps=60, extra=None, **more):
    """Write model.pt and net.yaml; ``weights`` (out, in) by layer; ``extra`` tensors as they are."""
    state = {}
    if neuron["type"] == "SRMALPHA":
        for name, tau, factor in (
            ("srmKernel", neuron["tauSr"], 1),
            ("refKernel", neuron["tauRef"], -neuron["scaleRef"] * neuron["theta"]),
        ):
            state[f"slayer.{name}"] = (
                torch.tensor(kernel(tau, factor)).float().reshape(1, 1, 1, 1, -1)
            )
    for name, weight in weights.items():
        state[f"{name}.weight"] = torch.tensor(weight).float()[..., None, None, None]
    torch.save(state | (extra or {}), folder / "model.pt")
    error = {
        "type": "NumSpikes",
        "tgtSpikeRegion": {"start": 0, "stop": steps},
        "tgtSpikeCount": {True: 150, False: 5},
    }
    config = {
        "simulation": {"Ts": 1.0, "tSample": steps},
        "neuron": neuron,
        "training": {"error": error},
        **more,
    }
    (folder / "net.yaml").write_text(yaml.safe_dump(config))
    return folder / "model.pt", folder / "net.yaml"


def srm_layer(weight, spikes, neuron=SRM, full=True):
    """Return the spikes (steps, out) of a layer, in slayer's order: filter the input, weigh it, spike.

    Kernels are ``full``, with their tails, or end where slayerPytorch ends them.
    """
    steps = len(spikes)
    k = np.arange(steps)

    def taps(tau, factor):
        if full:
            return factor * k / tau * np.exp(1 - k / tau)
        return np.pad(kernel(tau, factor), (0, steps))[:steps]

    eps = taps(neuron["tauSr"], 1.0)
    nu = taps(neuron["tauRef"], -neuron["scaleRef"] * neuron["theta"])
    filtered = np.array([sum(eps[t - s] * spikes[s] for s in range(t + 1)) for t in range(steps)])
    u = filtered @ weight.T
    out = np.zeros((steps, len(weight)))
    for t in range(steps):
        out[t] = u[t] >= neuron["theta"]
        u[t:] += nu[: steps - t, None] * out[t]
    return out


def normal_weights(outs, ins, mean=1.0):
    """Return weights (outs, ins) that single precision holds, with a standard deviation of 2."""
    rng = np.random.default_rng((4, outs, ins))  # alike in whichever order the tests run
    return rng.normal(mean, 2.0, (outs, ins)).astype(np.float32).astype(np.float64)


def sparse_spikes(lines, steps=60, rate=0.15):
    """Return spikes (steps, lines) of 0 and 1: in each step, each line spikes with a chance of ``rate``."""
    return (np.random.default_rng(8).random((steps, lines)) < rate).astype(np.uint8)
