"""Windows without descent: an output that finds the class with the nearest mean recording, its prototype.

As in linear discriminant analysis, distances are relative to how recordings differ from the prototype of their own
class, so that variations within classes count little:

    score of class k  =  m_k S h - m_k S m_k / 2          S = (ridge I + A^T A)^-1

h (hidden,) are the spikes of a recording, m_k is the mean of class k, and the rows of A (recordings, hidden) are the
training recordings minus the mean of their class. Only a matrix of recordings by recordings is inverted.
"""

from collections.abc import Iterable

import torch

from hw_model.values import Float32Array, IntArray
from locsnn_compile.errors import InputError
from locsnn_compile.models.networks import WindowNetwork
from locsnn_compile.models.touch_model import TouchModel

PROTOTYPES = "prototypes"
"""The name of this ``optimizer`` in a configuration."""


@torch.no_grad()
def set_prototypes(
    network: TouchModel, drawn: Iterable[tuple[Float32Array, IntArray]], smoothing: float
) -> None:
    """Set the output of a window network for recordings (spikes, labels), in batches.

    The ridge is ``smoothing`` times the mean squared distance of a recording to its prototype. Scores are scaled so
    that their standard deviation over classes is 1 on average. Raises ``InputError`` for other networks, for a
    class without recordings, and for a single class.
    """
    if not isinstance(network, WindowNetwork):
        fix = "Use another optimizer, or model window-snn."
        raise InputError(
            "training option 'optimizer'", "only window networks have prototypes", fix=fix
        )
    pairs = [(network.hidden(torch.from_numpy(x)), torch.from_numpy(y)) for x, y in drawn]
    hidden, labels = (torch.cat(parts) for parts in zip(*pairs, strict=True))
    member = torch.nn.functional.one_hot(labels, len(network.bias)).to(hidden)
    of_class = member.sum(dim=0)
    if not of_class.all():
        where, what = (
            f"label {int(of_class.argmin())}",
            "it has no recording to learn from, so it has no prototype",
        )
        raise InputError(
            where, what, fix="Use another optimizer, or number the labels without a gap."
        )
    if len(of_class) == 1:
        fix = "Use another optimizer, or recordings of several classes."
        raise InputError(
            "training option 'optimizer'",
            "prototypes tell classes apart, and there is one",
            fix=fix,
        )
    means = member.T @ hidden / of_class[:, None]
    apart = hidden - means[labels]
    products = (apart @ apart.T).double()
    ridge = smoothing * products.trace() / len(hidden) + torch.finfo(torch.float32).tiny
    solved = torch.linalg.solve(
        products + ridge * torch.eye(len(hidden)), (apart @ means.T).double()
    )
    output = means - solved.T.to(hidden) @ apart
    bias = -0.5 * (output * means).sum(dim=1) + output @ network.usual
    scores = (hidden - network.usual) @ output.T + bias
    scale = 1.0 / scores.std(dim=1).mean().clamp(min=torch.finfo(torch.float32).tiny)
    network.output.copy_(scale * output)
    network.bias.copy_(scale * bias)
