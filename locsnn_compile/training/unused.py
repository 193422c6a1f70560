"""Options of a training run that nothing would come of, and what they need."""

from collections.abc import Callable, Mapping

from hw_model.values import Frozen
from locsnn_compile.errors import InputError
from locsnn_compile.models.architectures import ARCHITECTURES, Architecture
from locsnn_compile.training.config import LOCATION_CONSTANTS, TrainingConfig


class _Rule(Frozen):
    """``options`` count where ``holds``; elsewhere nothing comes of them, because of ``why``."""

    options: tuple[str, ...]
    holds: Callable[[TrainingConfig, Architecture], bool]
    why: str
    fix: str


_LEAVE = "Leave it out."
_LOCATION = {kind: tuple(f"location_{name}" for name in names) for kind, names in LOCATION_CONSTANTS.items()}
_RULES = (
    _Rule(
        ("strategy", "weight_bits", "weight_room", "refractory"),
        lambda c, _: c.target != "float",
        "the network is trained in float, and no chip holds it",
        "Add --target CHIP.",
    ),
    _Rule(("refractory",), lambda c, _: c.strategy == "reset", "only strategy reset has it", "Add strategy reset."),
    _Rule(
        ("order", "location_delays", *_LOCATION["srm"], *_LOCATION["lif"]),
        lambda _, a: "location" in a.branches,
        "the network has no location branch",
        _LEAVE,
    ),
    _Rule(
        ("location_weight", "branch_loss", "psi"),
        lambda _, a: len(a.branches) > 1,
        "the network has no second branch",
        _LEAVE,
    ),
    _Rule(
        ("align_events",), lambda _, a: a.branches != (), "the network reads recordings from their first step", _LEAVE
    ),
    _Rule(("hidden",), lambda _, a: a.neurons != "windows", "events and windows decide the hidden neurons", _LEAVE),
    _Rule(
        ("graph", "neighbours", "nearer_mm", "hops", "features", "step_features"),
        lambda _, a: a.graph,
        "the network has no graph",
        "Choose a model with one, such as hybrid-graph.",
    ),
    _Rule(
        ("theta", "tau_sr", "tau_ref", "scale_ref", "tau_rho", "scale_rho", *_LOCATION["srm"]),
        lambda _, a: a.neurons == "srm",
        "the network has no spike response neurons",
        _LEAVE,
    ),
    _Rule(
        ("decay", "threshold", "window", *_LOCATION["lif"]),
        lambda _, a: a.neurons == "lif",
        "it has no integrate-and-fire neurons",
        _LEAVE,
    ),
    _Rule(
        ("window_steps", "window_stride", "window_levels"),
        lambda _, a: a.window_branch != "",
        "the network has no windows",
        "Choose the model window-snn.",
    ),
    _Rule(
        ("target_right", "target_wrong"),
        lambda c, _: c.loss == "spike-count",
        "the loss is cross-entropy, which has no target",
        "Add --loss spike-count.",
    ),
    _Rule(
        ("count_scale", "label_smoothing", "neighbour_smoothing", "class_order"),
        lambda c, _: c.loss == "cross-entropy",
        "the loss is spike-count, which takes counts as they are",
        _LEAVE,
    ),
    _Rule(
        ("neighbour_smoothing",),
        lambda c, _: c.class_order != "",
        "nothing says which classes are neighbours",
        "Add class_order, such as '0-4 5-9'.",
    ),
    _Rule(
        ("class_order",), lambda c, _: c.neighbour_smoothing > 0, "neighbours get no share", "Add neighbour_smoothing."
    ),
)


def check_used(given: Mapping[str, str], *configs: TrainingConfig) -> None:
    """Refuse options that change nothing in any of the configurations with an ``InputError``.

    ``given``: how messages show each option that was given.
    """
    for rule in _RULES:
        counts = any(rule.holds(config, ARCHITECTURES[config.model]) for config in configs)
        for option in rule.options:
            if option in given and not counts:
                raise InputError(given[option], f"it would change nothing: {rule.why}", fix=rule.fix)
