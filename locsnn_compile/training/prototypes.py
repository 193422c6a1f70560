"""Compute the output weights of a window network without gradient descent, from prototypes of the classes.

In a network that counts events in windows (``window-snn``), hidden neurons do not learn, so the output is a linear
classifier of their spikes. This one predicts the class with the nearest *prototype*, the mean of its training
recordings. As in linear discriminant analysis, distances are relative to how recordings differ from the prototype of
their own class, so that variations within classes count little:

    score of class k  =  m_k S h - m_k S m_k / 2          S = (ridge I + A^T A)^-1

h (hidden,) are the hidden spikes of a recording, m_k is the prototype of class k, and the rows of A (recordings,
hidden) are the hidden spikes of the training recordings minus the prototype of their class. S is never formed. The
system that is solved has a row per hidden neuron or per recording, whichever are fewer:

    (A^T A + ridge I) S m_k = m_k,     or     ridge S m_k = m_k - A^T (A A^T + ridge I)^-1 A m_k

A common factor of all scores does not change the prediction.
"""

from collections.abc import Iterable

import torch
from torch import Tensor

from hw_model.values import Float32Array, Frozen, IntArray
from locsnn_compile.errors import InputError, check_most
from locsnn_compile.models.networks import WindowNetwork
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig

PROTOTYPES = "prototypes"
"""The name of this ``optimizer`` in a configuration."""
MOST_GIBIBYTES = 16.0
"""Largest memory that a run may take; larger runs are refused."""
STATED_FROM = 1.0
"""Memory in GiB from which a run tells the user, beforehand, how much it takes."""


class Size(Frozen):
    """The size of the matrix A: ``copies`` of recordings (rows) and ``hidden`` neurons (columns).

    A copy is a recording as augmentation changed it in one epoch.
    """

    copies: int
    hidden: int

    @property
    def is_by_hidden(self) -> bool:
        """Whether the system has a row for each hidden neuron, because these are fewer than the copies."""
        return self.hidden < self.copies

    @property
    def unknowns(self) -> int:
        """The rows of the system that is solved."""
        return min(self.copies, self.hidden)

    @property
    def gibibytes(self) -> float:
        """The memory that it takes: spikes twice in float32, and the system twice in float64."""
        return (2 * 4 * self.copies * self.hidden + 2 * 8 * self.unknowns**2) / 2**30

    @property
    def words(self) -> str:
        """The sentence that states it."""
        by = "hidden neurons" if self.is_by_hidden else "recordings"
        of_all = f"{self.copies:,} copies of recordings and {self.hidden:,} hidden neurons"
        return (
            f"Prototypes of {of_all} are solved by {by}, and take about {self.gibibytes:.1f} GiB."
        )


def repeats(config: TrainingConfig) -> int:
    """Return the number of epochs whose copies are used: 1 without augmentation, because all copies are then equal."""
    drawn = (
        config.event_dropout,
        config.channel_dropout,
        config.taxel_dropout,
        config.event_noise,
        config.mixing,
        config.cut_end,
        config.time_stretch,
        config.time_shift,
        config.taxel_shift,
    )
    return config.epochs if any(drawn) else 1


def size_of(network: TouchModel, recordings: int, config: TrainingConfig) -> Size:
    """Return the size of a run over so many recordings; ``InputError`` for other networks, and if it is too large."""
    size = Size(recordings * repeats(config), _windows_of(network).output.shape[1])
    fix = "Give fewer --epochs, longer windows (window_steps, window_stride), or optimizer sgd."
    what = "prototypes take too much memory"
    check_most(
        round(size.gibibytes, 1),
        MOST_GIBIBYTES,
        "training option 'optimizer'",
        what,
        unit="GiB",
        fix=fix,
    )
    return size


def _windows_of(network: TouchModel) -> WindowNetwork:
    """Return the network as a window network; ``InputError`` for any other."""
    if not isinstance(network, WindowNetwork):
        fix = "Use another optimizer, or model window-snn."
        raise InputError(
            "training option 'optimizer'", "only window networks have prototypes", fix=fix
        )
    return network


@torch.no_grad()
def set_prototypes(
    network: TouchModel, drawn: Iterable[tuple[Float32Array, IntArray]], smoothing: float
) -> None:
    """Set the output weights and biases of a window network by its training recordings.

    ``drawn`` are batches (spikes, labels), as :func:`locsnn_compile.training.batches.batches` yields them. The ridge is
    ``smoothing`` times the mean squared distance of a recording to its prototype. Scores are scaled so that their
    standard deviation over classes is 1 on average. Raises ``InputError`` for other networks, for a class without
    recordings, and for a single class.
    """
    windows = _windows_of(network)
    hidden_of_batches = []
    labels_of_batches = []
    for spikes, batch_labels in drawn:
        hidden_of_batches.append(windows.hidden(torch.from_numpy(spikes)))
        labels_of_batches.append(torch.from_numpy(batch_labels))
    hidden = torch.cat(hidden_of_batches)
    labels = torch.cat(labels_of_batches)
    is_member = torch.nn.functional.one_hot(labels, len(windows.bias)).to(hidden)
    of_class = is_member.sum(dim=0)
    _check_classes(of_class)
    means = is_member.T @ hidden / of_class[:, None]
    output = _solved(hidden - means[labels], means, smoothing)
    # The network multiplies its weights by hidden spikes minus their mean (``usual``): the bias makes up for that.
    bias = -0.5 * (output * means).sum(dim=1) + output @ windows.usual
    scores = (hidden - windows.usual) @ output.T + bias
    # Never a division by 0, if all scores are equal.
    scale = 1.0 / scores.std(dim=1).mean().clamp(min=torch.finfo(torch.float32).tiny)
    windows.output.copy_(scale * output)
    windows.bias.copy_(scale * bias)


def _check_classes(of_class: Tensor) -> None:
    """Refuse a class without recordings, and a single class; ``of_class``: the number of recordings of each."""
    if not of_class.all():
        where = f"label {int(of_class.argmin())}"
        what = "it has no recording to learn from, so it has no prototype"
        fix = "Use another optimizer, or number the labels without a gap."
        raise InputError(where, what, fix=fix)
    if len(of_class) == 1:
        fix = "Use another optimizer, or recordings of several classes."
        raise InputError(
            "training option 'optimizer'",
            "prototypes tell classes apart, and there is one",
            fix=fix,
        )


def _solved(apart: Tensor, means: Tensor, smoothing: float) -> Tensor:
    """Return ridge * S m_k, (classes, hidden).

    ``apart`` is the matrix A of the module's docstring, (recordings, hidden), and ``means`` are the prototypes m_k,
    (classes, hidden). The system is solved in float64, because it is often nearly singular.
    """
    copies, hidden = apart.shape
    # Never 0, so that the system can be solved even if every recording equals its prototype.
    least_ridge = torch.finfo(torch.float32).tiny
    if Size(copies, hidden).is_by_hidden:
        products = (apart.T @ apart).double()
        # The trace divided by the recordings is their mean squared distance to their prototypes.
        ridge = smoothing * products.trace() / copies + least_ridge
        products.diagonal().add_(ridge)
        whitened: Tensor = torch.linalg.solve(products, means.T.double())
        return ridge.to(apart) * whitened.T.to(apart)
    products = (apart @ apart.T).double()
    ridge = smoothing * products.trace() / copies + least_ridge
    products.diagonal().add_(ridge)
    solved: Tensor = torch.linalg.solve(products, (apart @ means.T).double())
    return means - solved.T.to(apart) @ apart
