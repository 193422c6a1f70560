"""Join several networks with the same input into one, whose class scores are the weighted sums of theirs.

The joined network is a *committee*, and its networks are the *members*. It is compiled like any other network, so all
members run on one chip side by side.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from hashlib import sha256
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hw_model.mapping.graph import Phase, Readout
from locsnn_compile.data.recordings import Recordings
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
"""Fields of ``Network`` on which members must agree; a member that has None there agrees with all."""
MOST_APART = 1_000_000
"""Largest ratio of two weights; with larger ones, sums of scores could be too large for exact float64 integers."""


def committee(networks: Sequence[Network], weights: Sequence[float], name: str = "") -> Network:
    """Join networks; populations become ``member/population``. Members share equal inputs and equal phases.

    Phases are equal if name, axis, steps and start are equal. Raises ``InputError`` for members that disagree, and
    unless there is one weight above 0 per network.
    """
    _check_networks(networks)
    _check_weights(weights, networks)
    agreed = {key: _shared(key, networks) for key in _SHARED}
    _shared("classes", networks)  # not a field of the committee, but members must agree on it
    joined = _Joined()
    for network, weight in zip(networks, weights, strict=True):
        joined.add(network, float(weight))
    hashes = " ".join(network.sha256 for network in networks)
    assumptions = [sentence for network in networks for sentence in network.assumptions]
    return Network(
        name=name or "+".join(member.name for member in joined.members),
        views=tuple(joined.views),
        populations=tuple(joined.populations),
        projections=tuple(joined.projections),
        readout=_readout(joined.terms, networks),
        sha256=sha256(hashes.encode()).hexdigest(),
        recordings=_first_recordings(networks),
        assumptions=tuple(dict.fromkeys(assumptions)),
        psi=_common_psi(networks),
        trained_on={
            name: bits for network in networks for name, bits in network.trained_on.items()
        },
        members=tuple(joined.members),
        **agreed,
    )


def _check_networks(networks: Sequence[Network]) -> None:
    """Refuse objects that are not networks, and networks with layers on the host."""
    if not networks or not all(isinstance(network, Network) for network in networks):
        types = ", ".join(type(network).__name__ for network in networks) or "none"
        raise InputError(
            "networks",
            "they are not networks",
            measured=f"got {types}",
            fix="Read each with lc.load.",
        )
    for network in networks:
        if network.host is not None:
            what = "it has layers on the host, and networks are joined without such layers"
            raise InputError(f"model {network.name!r}", what, fix="Compile it by itself.")


def _check_weights(weights: Sequence[float], networks: Sequence[Network]) -> None:
    """Refuse weights unless there is one above 0 per network, and weights that are too far apart."""
    has_one_each = len(weights) == len(networks)
    if not has_one_each or not all(0 < weight <= MOST_APART * min(weights) for weight in weights):
        shown = ", ".join(f"{weight:g}" for weight in weights)
        raise InputError(
            "weights",
            f"each network needs one above 0, at most {MOST_APART:,} times any other",
            measured=f"{shown} for {len(networks)} networks",
            fix="Give numbers such as 1,2.",
        )


class _Term(NamedTuple):
    """A population that the readout reads.

    ``weight`` is that of its class scores. With ``from_step``, its largest potentials from that step on are read,
    otherwise its spikes.
    """

    population: str
    weight: float
    from_step: int | None


class _Joined:
    """Collects the parts of one network after the other, under the names that they have in the committee."""

    def __init__(self) -> None:
        self.members: list[Member] = []
        self.views: list[InputView] = []
        self.populations: list[Population] = []
        self.projections: list[Projection | ChipProjection] = []
        self.terms: list[_Term] = []
        self._phase_names: dict[Phase, str] = {}

    def add(self, network: Network, weight: float) -> None:
        """Add the parts of a network; ``weight`` is that of its class scores."""
        member = self._add_member(network, weight)
        phase_names = self._shared_phases(network)
        new_names = {p.name: f"{member}/{p.name}" for p in network.populations}
        new_names |= self._shared_views(network, phase_names)
        for p in network.populations:
            phase = phase_names[p.phase]
            self.populations.append(replace(p, name=new_names[p.name], own_phase=phase))
        for projection in network.projections:
            source = new_names[projection.source]
            target = new_names[projection.target]
            self.projections.append(replace(projection, source=source, target=target))
        from_step = network.readout.from_step
        for name, weight_within in network.readout.terms:
            term = _Term(new_names[name], weight * weight_within, from_step.get(name))
            self.terms.append(term)

    def _add_member(self, network: Network, weight: float) -> str:
        """Add a member, and return its name, without slashes: a slash ends it in the names of populations."""
        taken = [member.name for member in self.members]
        name = _free(network.name.replace("/", "_"), taken)
        self.members.append(Member(name, network.sha256, weight))
        return name

    def _shared_phases(self, network: Network) -> dict[str, str]:
        """Return the names of a network's phases in the committee, which equal phases share."""
        return {
            phase.name: self._phase_names.setdefault(
                phase, _free(phase.name, self._phase_names.values())
            )
            for phase in network.phases
        }

    def _shared_views(self, network: Network, phase_names: Mapping[str, str]) -> dict[str, str]:
        """Return the names of a network's inputs in the committee, which equal inputs share."""
        names = {}
        for view in network.views:
            # A view in a phase without populations feeds nothing.
            if view.phase in phase_names:
                in_phase = replace(view, own_phase=phase_names[view.phase])
                names[view.name] = _input(self.views, in_phase)
        return names


def _first_recordings(networks: Sequence[Network]) -> Recordings | None:
    """Return the recordings of the first network that carries some."""
    carried = (network.recordings for network in networks)
    return next((recordings for recordings in carried if recordings is not None), None)


def _common_psi(networks: Sequence[Network]) -> float | None:
    """Return the psi that all networks have; None if they differ, since a committee has one psi."""
    values = {network.psi for network in networks}
    return values.pop() if len(values) == 1 else None


def _readout(terms: Sequence[_Term], networks: Sequence[Network]) -> Readout:
    """Return the readout that adds the class scores of all terms."""
    names, weights, from_steps = zip(*terms, strict=True)
    return Readout(names, weights, from_steps, _tie_class(networks))


def _tie_class(networks: Sequence[Network]) -> int | None:
    """Return the class that all members predict on a tie of all scores; None if members name different ones."""
    named = {network.readout.tie_class for network in networks}
    return named.pop() if len(named) == 1 else None


def _shared(key: str, networks: Sequence[Network]) -> Any:
    """Return the value of a field on which the networks agree, None if no network has a value.

    Raises ``InputError`` for values that differ.
    """
    values = [(network.name, getattr(network, key)) for network in networks]
    stated = [(name, value) for name, value in values if value is not None]
    for (earlier, expected), (name, value) in pairwise(stated):
        if value != expected:
            what = f"it differs from {earlier!r} in {key.replace('_', ' ')}"
            measured = f"{_short(value)} against {_short(expected)}"
            raise InputError(
                f"model {name!r}", what, measured=measured, fix="Join networks of one input."
            )
    return stated[0][1] if stated else None


def _short(value: Any) -> str:
    """Return a value as messages show it: a sensor by its name, texts without brackets."""
    shown = ", ".join(value) if isinstance(value, tuple) else str(getattr(value, "name", value))
    return shown[:60]


def _free(name: str, taken: Collection[str]) -> str:
    """Return a name that is not taken: the name itself, or with the first free number from 2 up."""
    free = name
    number = 1
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    return free


def _input(views: list[InputView], view: InputView) -> str:
    """Return the name of the view that plays the same spikes in the same phase; add this view if there is none."""
    what_it_plays = [field.name for field in fields(view) if field.name != "name"]
    for shared in views:
        if all(np.array_equal(getattr(view, key), getattr(shared, key)) for key in what_it_plays):
            return shared.name
    name = _free(view.name, [shared.name for shared in views])
    views.append(replace(view, name=name))
    return name
