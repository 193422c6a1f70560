"""Write slayerPytorch checkpoints and their YAML as its modules save them, and run its forward pass in plain numpy.

slayerPytorch's spike response neurons filter spikes by a kernel (alpha function) of time constant tauSr, and add a
refractory kernel of tauRef after each of their own spikes.
"""

import numpy as np
import torch
import yaml

SMALLEST = 0.01
"""slayerPytorch ends a kernel at the first lag beyond tau at which its magnitude is below this."""
# The neuron of Kang et al., IJCNN 2022. The rho entries shape gradients only.
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
    """Return the taps of slayerPytorch's _calculateAlphaKernel with a Ts of 1, for kernels that end within 1,000 steps."""
    taps = []
    for t in range(1000):
        value = factor * t / tau * np.exp(1 - t / tau)
        if abs(value) < SMALLEST and t > tau:
            break
        taps.append(value)
    return np.array(taps)


def write(folder, weights, neuron=SRM, steps=60, extra=None, **more):
    """Write model.pt and net.yaml to a folder, and return their paths.

    ``weights`` (out, in) are by layer name; ``extra`` tensors are added to the checkpoint, ``more`` entries to the YAML.
    slayerPytorch's layers are 3-d convolutions over (height, width, time), hence the additional axes of length 1.
    """
    state = {}
    if neuron["type"] == "SRMALPHA":
        kernels = {
            "srmKernel": kernel(neuron["tauSr"], 1),
            "refKernel": kernel(neuron["tauRef"], -neuron["scaleRef"] * neuron["theta"]),
        }
        for name, taps in kernels.items():
            state[f"slayer.{name}"] = torch.tensor(taps).float().reshape(1, 1, 1, 1, -1)
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

    With ``full`` kernels have their whole tails; otherwise they end where slayerPytorch ends them.
    """
    steps = len(spikes)
    k = np.arange(steps)

    def taps(tau, factor):
        if full:
            return factor * k / tau * np.exp(1 - k / tau)
        return np.pad(kernel(tau, factor), (0, steps))[:steps]

    response = taps(neuron["tauSr"], 1.0)
    refractory = taps(neuron["tauRef"], -neuron["scaleRef"] * neuron["theta"])
    filtered = np.zeros(np.shape(spikes))
    for t in range(steps):
        filtered[t] = sum(response[t - s] * spikes[s] for s in range(t + 1))
    u = filtered @ weight.T
    out = np.zeros((steps, len(weight)))
    for t in range(steps):
        out[t] = u[t] >= neuron["theta"]
        u[t:] += refractory[: steps - t, None] * out[t]
    return out


def normal_weights(outs, ins, mean=1.0):
    """Return random weights (outs, ins) with a standard deviation of 2, whose values single precision holds exactly."""
    # Seeded here, so that they do not depend on the order of the tests.
    rng = np.random.default_rng((4, outs, ins))
    return rng.normal(mean, 2.0, (outs, ins)).astype(np.float32).astype(np.float64)


def sparse_spikes(lines, steps=60, rate=0.15):
    """Return random spikes (steps, lines) of 0 and 1; each line spikes in a step with probability ``rate``."""
    return (np.random.default_rng(8).random((steps, lines)) < rate).astype(np.uint8)
