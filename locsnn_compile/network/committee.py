"""Several networks with the same input as one network, whose class scores are the weighted sums of theirs."""

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from hashlib import sha256
from itertools import pairwise
from typing import Any

import numpy as np

from hw_model.mapping.graph import Phase, Readout
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import InputView, Member, Network, Population
from locsnn_compile.network.projections import ChipProjection, Projection

_SHARED = (
    "channels",
    "steps",
    "any_length",
    "step_seconds",
    "usual_step_seconds",
    "sensor",
    "event_threshold",
    "class_names",
    "inputs",
    "channel_order",
    "event_times",
    "recorded",
)
"""What members must agree on, unless it is None."""
MOST_APART = 1_000_000
"""Largest ratio of two weights: sums of scores stay whole numbers that a float64 holds."""


def committee(networks: Sequence[Network], weights: Sequence[float], name: str = "") -> Network:
    """Join networks; populations become ``member/population``. Equal inputs and equal phases are shared.

    Phases are equal if name, axis, steps and start are equal. Raises ``InputError`` for members that disagree, and
    unless there is one weight above 0 per network.
    """
    if not networks or not all(isinstance(network, Network) for network in networks):
        given = ", ".join(type(network).__name__ for network in networks) or "none"
        raise InputError(
            "networks",
            "they are not networks",
            measured=f"got {given}",
            fix="Read each with lc.load.",
        )
    for network in networks:
        if network.host is not None:
            what = "it has layers on the host, and networks are joined without such layers"
            raise InputError(f"model {network.name!r}", what, fix="Compile it by itself.")
    if len(weights) != len(networks) or not all(
        0 < w <= MOST_APART * min(weights) for w in weights
    ):
        measured = f"{', '.join(f'{w:g}' for w in weights)} for {len(networks)} networks"
        what = f"each network needs one above 0, at most {MOST_APART:,} times any other"
        raise InputError("weights", what, measured=measured, fix="Give numbers such as 1,2.")
    shared = {key: _shared(key, networks) for key in _SHARED}
    _shared("classes", networks)
    phases: dict[Phase, str] = {}
    views: list[InputView] = []
    members: list[Member] = []
    populations: list[Population] = []
    projections: list[Projection | ChipProjection] = []
    terms: list[tuple[str, float, int | None]] = []
    for network, weight in zip(networks, weights, strict=True):
        member = _free(network.name.replace("/", "_"), [other.name for other in members])
        members.append(Member(member, network.sha256, float(weight)))
        phase = {
            its.name: phases.setdefault(its, _free(its.name, phases.values()))
            for its in network.phases
        }
        new = {p.name: f"{member}/{p.name}" for p in network.populations}
        for view in network.views:
            if view.phase in phase:
                new[view.name] = _input(views, replace(view, own_phase=phase[view.phase]))
        populations += [
            replace(p, name=new[p.name], own_phase=phase[p.phase]) for p in network.populations
        ]
        projections += [
            replace(p, source=new[p.source], target=new[p.target]) for p in network.projections
        ]
        read = network.readout.from_step
        terms += [(new[its], weight * w, read.get(its)) for its, w in network.readout.terms]
    return Network(
        name=name or "+".join(member.name for member in members),
        views=tuple(views),
        populations=tuple(populations),
        projections=tuple(projections),
        readout=_readout(terms, networks),
        sha256=sha256(" ".join(network.sha256 for network in networks).encode()).hexdigest(),
        recordings=next(
            (network.recordings for network in networks if network.recordings is not None), None
        ),
        assumptions=tuple(
            dict.fromkeys(said for network in networks for said in network.assumptions)
        ),
        psi=networks[0].psi if len({network.psi for network in networks}) == 1 else None,
        trained_on={
            name: bits for network in networks for name, bits in network.trained_on.items()
        },
        members=tuple(members),
        **shared,
    )


def _readout(
    terms: Sequence[tuple[str, float, int | None]], networks: Sequence[Network]
) -> Readout:
    """Return the readout of terms: a population, its weight, and the step from which its potentials count."""
    names, weights, first = zip(*terms, strict=True)
    return Readout(names, weights, first, _tie_class(networks))


def _tie_class(networks: Sequence[Network]) -> int | None:
    """Return the class that all members name for ties; None if they differ, as the sum then ties by other means."""
    named = {network.readout.tie_class for network in networks}
    return named.pop() if len(named) == 1 else None


def _shared(key: str, networks: Sequence[Network]) -> Any:
    """Return the value that the networks agree on, None if none has one; refuse values that differ."""
    said = [
        (network.name, value)
        for network in networks
        if (value := getattr(network, key)) is not None
    ]
    for (first, its), (name, value) in pairwise(said):
        if value != its:
            what = f"it differs from {first!r} in {key.replace('_', ' ')}"
            measured = f"{_short(value)} against {_short(its)}"
            raise InputError(
                f"model {name!r}", what, measured=measured, fix="Join networks of one input."
            )
    return said[0][1] if said else None


def _short(value: Any) -> str:
    """Return a value as messages show it: a sensor by its name, texts without brackets."""
    return (", ".join(value) if isinstance(value, tuple) else str(getattr(value, "name", value)))[
        :60
    ]


def _free(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number if it is taken."""
    return next(
        free
        for i in range(1, len(taken) + 2)
        if (free := name if i == 1 else f"{name}_{i}") not in taken
    )


def _input(views: list[InputView], view: InputView) -> str:
    """Return the name of the view that plays the same; add this one if there is none."""
    parts = [field.name for field in fields(view) if field.name != "name"]
    for other in views:
        if all(np.array_equal(getattr(view, part), getattr(other, part)) for part in parts):
            return other.name
    views.append(replace(view, name=_free(view.name, [other.name for other in views])))
    return views[-1].name
