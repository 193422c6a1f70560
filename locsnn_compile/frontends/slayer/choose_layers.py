"""Choose the layers of a checkpoint that run, and their branch: as the user or the YAML says, else by their names.

A state dict has no structure: it can contain layers that the forward pass never runs, and layers that run over the
outputs of both branches (*joined*). So the choice is listed as an assumption, and a choice that is likely wrong is
refused.
"""

import math
from collections.abc import Mapping

from hw_model.mapping.graph import AXES, Axis
from hw_model.values import Frozen
from locsnn_compile.errors import InputError, did_you_mean
from locsnn_compile.frontends.linear_maps import Shape
from locsnn_compile.frontends.slayer.branches import JOINED, Branches
from locsnn_compile.frontends.slayer.config import SlayerConfig, axis_of


class Chosen(Frozen):
    """The layers that run: a chain for each axis.

    - ``channels``: the number of channels of the recordings, where only the choice of layers tells it: no layer runs
      along time, but an unused time layer, or the steps over which training counted spikes, have as many. None if the
      first layer along time has them as its inputs, or if nothing tells
    - ``assumed``: sentences about assumptions
    """

    chains: Mapping[Axis, tuple[str, ...]]
    channels: int | None
    assumed: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All layers that run."""
        return tuple(name for chain in self.chains.values() for name in chain)


def choose_layers(
    shapes: Mapping[str, Shape], config: SlayerConfig, branches: Branches | None, where: str
) -> Chosen:
    """Return the layers of a checkpoint that run.

    ``shapes`` are the shapes (out, in, ...) of the weights of every layer, in the order of the checkpoint. ``branches``
    are those that the user states; they take precedence over those of the YAML.
    """
    stated = config.branches if branches is None else branches
    if stated is not None:
        return _stated(shapes, stated, where)
    # Nobody states the branches, so the names of the layers decide.
    by_name: dict[Axis, tuple[str, ...]] = {
        axis: tuple(name for name in shapes if axis_of(name) == axis) for axis in AXES
    }
    chains = {axis: names for axis, names in by_name.items() if names}
    # The two doubts below are about which of two branches run. They do not arise with one branch, nor if the YAML lists
    # its layers: its author has then said which layers there are, and that all of them run.
    if config.layers or len(chains) == 1:
        return Chosen(chains, channels=None, assumed=_all_taken(chains, config))
    if _trained_location_alone(shapes, chains, config):
        locations: dict[Axis, tuple[str, ...]] = {"location": chains["location"]}
        sentence = (
            f"The YAML counts the spikes of {config.counted_steps} steps, which are the locations: the location branch "
            f"runs alone, of the layers {_text(locations)}, and {', '.join(chains['time'])} are not used (--branches)."
        )
        return Chosen(locations, config.counted_steps, (sentence,))
    _refuse_joined(shapes, chains, where)
    return Chosen(chains, channels=None, assumed=_all_taken(chains, config))


def _stated(shapes: Mapping[str, Shape], branches: Branches, where: str) -> Chosen:
    """Return the layers that branches name.

    Raises ``InputError`` for layers that do not exist, are named twice, or belong to the branch :data:`JOINED`.
    """
    named = [name for layers in branches.values() for name in layers]
    for name in named:
        if name not in shapes:
            raise InputError(
                # Cut, because the name is the user's and may be of any length; those below are in the checkpoint.
                f"{where}, layer {name[:80]!r}",
                "it is not in the checkpoint",
                fix=did_you_mean(name, shapes),
            )
        if named.count(name) > 1:
            raise InputError(
                f"{where}, layer {name!r}", "it is named twice", fix="Name it in one branch."
            )
    for name in branches.get(JOINED, ()):
        raise InputError(
            f"{where}, layer {name!r}",
            "it runs over the outputs of both branches, one after the other, which no phase of a program does",
            fix="Train the network without it.",
        )
    chains: dict[Axis, tuple[str, ...]] = {
        axis: branches[axis] for axis in AXES if axis in branches
    }
    unused = tuple(name for name in shapes if name not in named)
    assumed = []
    channels = None
    if unused:
        assumed.append(
            f"These layers of the checkpoint are not used, as no branch names them: {', '.join(unused)}."
        )
    of_time = tuple(name for name in unused if axis_of(name) == "time")
    if "time" not in chains and of_time:
        channels = _inputs(shapes[of_time[0]])
        assumed.append(
            f"There are {channels} channels, the inputs of {of_time[0]}, which is not used."
        )
    return Chosen(chains, channels, tuple(assumed))


def _inputs(shape: Shape) -> int:
    """Return the number of inputs of a layer of weights (out, in, ...)."""
    return math.prod(shape[1:])


def _all_taken(chains: Mapping[Axis, tuple[str, ...]], config: SlayerConfig) -> tuple[str, ...]:
    """Return the sentence that all layers were taken by their names, as a tuple of one.

    Empty where there was nothing to choose: for a single layer, or if the YAML lists the layers.
    """
    if config.layers or sum(map(len, chains.values())) == 1:
        return ()
    return (
        "The checkpoint does not say which layers run, nor over what: all were taken by their names and order, "
        f"{_text(chains)} (--branches).",
    )


def _text(chains: Mapping[Axis, tuple[str, ...]]) -> str:
    """Return chains in the form of the option ``--branches``."""
    return ", ".join(f"{axis}={','.join(names)}" for axis, names in chains.items())


def _trained_location_alone(
    shapes: Mapping[str, Shape], chains: Mapping[Axis, tuple[str, ...]], config: SlayerConfig
) -> bool:
    """Return whether only the location branch was trained: spikes were counted over as many steps as locations.

    The inputs of a time branch are the locations (channels), those of a location branch the time steps. Needs both.
    """
    locations = _inputs(shapes[chains["time"][0]])
    time_steps = _inputs(shapes[chains["location"][0]])
    # With as many locations as time steps, the count fits either branch, so it tells nothing.
    return config.counted_steps == locations and locations != time_steps


def _refuse_joined(
    shapes: Mapping[str, Shape], chains: Mapping[Axis, tuple[str, ...]], where: str
) -> None:
    """Raise ``InputError`` if the last layer of the checkpoint seems to run over the outputs of both branches.

    By its name, it would be the last layer of the time branch. But it has one input per class, as many as either branch
    has outputs without it, and comes after all layers of both branches: this suggests that each branch ended before it.
    ``chains`` has both branches.
    """
    *before, last = chains["time"]
    if not before:
        # It is the only layer along time, so there is no time branch that could have ended before it.
        return
    # The outputs of a branch are the classes: the rows of the weights of its last layer.
    classes = shapes[chains["location"][-1]][0]
    time_outputs_before = shapes[before[-1]][0]
    if time_outputs_before != classes or _inputs(shapes[last]) != classes:
        return
    in_order = list(shapes)
    location_first = in_order.index(before[0]) > in_order.index(chains["location"][0])
    is_no_deeper = len(chains["time"]) <= len(chains["location"])
    if in_order[-1] != last:
        return
    # If the location branch comes first, the checkpoint ends with a time layer anyway, so its last layer may be the
    # time branch's own, unless that branch would then be deeper than the location branch.
    if location_first and is_no_deeper:
        return
    branches = f"time={','.join(before)},location={','.join(chains['location'])}"
    raise InputError(
        f"{where}, layer {last!r}",
        "it may run over the outputs of both branches, one after the other, which no phase of a program does",
        fix=f"If it does not run, give --branches {branches}; if it is the time branch's, name it there.",
    )
