"""Refuse programs and recordings that Lava's fixed-point models would not play as the chip ``loihi-sim`` does.

Settings and formats of synapses are checked in the program. Registers are checked in the recording that is shown: both
models compute the same as long as no register wraps, and no current is -2^23. ``loihi-sim`` holds currents from -2^23
to 2^23 - 1, and Lava currents from -2^23 + 1 to 2^23.
"""

from collections.abc import Callable

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.program.chip_program import Core
from hw_model.values import BoolArray, Frozen, IntArray
from locsnn_compile.backends.played import Played
from locsnn_compile.errors import InputError, counted

WHERE = "--emit lava"
CURRENT_LIMIT = 1 << 23
"""Lava turns a current of minus this into plus this."""
VOLTAGE_MAX = CURRENT_LIMIT - 1
"""Lava clips v to plus and minus this, whatever a core is set to."""


class Rule(Frozen, eq=False):
    """A setting of compartments with the values that Lava does not have, and the words of the error.

    - ``value``: returns the setting of each compartment of a core, (compartments,)
    - ``breaks``: marks the values that are refused, (compartments,)
    - ``what``, ``fix``: what Lava lacks, and what the user can do
    """

    setting: str
    value: Callable[[Core], IntArray]
    breaks: Callable[[IntArray], BoolArray]
    what: str
    fix: str


def _everywhere(core: Core, value: int) -> IntArray:
    """Return a setting of a whole core for each of its compartments, (compartments,)."""
    return np.full(core.compartments, value, dtype=np.int64)


RULES = (
    Rule(
        "parent",
        lambda core: core.parent,
        lambda parent: parent >= 0,
        "Lava has no joined compartments",
        "Compile with --strategy reset, or emit another kind.",
    ),
    Rule(
        "refractory",
        lambda core: core.setting("refractory"),
        lambda steps: steps != 1,
        "Lava's fixed-point neuron has no refractory period",
        "Give its neurons a refractory of 1, or emit another kind.",
    ),
    Rule(
        "decay_u",
        lambda core: core.setting("decay_u"),
        lambda decay: decay == loihi.KEEPS_ALL,
        "Lava's currents lose at least 1 part of 4096 in a step",
        "Give its neurons a current that fades, or emit another kind.",
    ),
    Rule(
        "decay_v",
        lambda core: core.setting("decay_v"),
        lambda decay: decay == loihi.FORGETS,
        "Lava's potentials lose at most 4095 parts of 4096 in a step",
        "Give its neurons a potential that lasts, or emit another kind.",
    ),
    Rule(
        "vmin",
        lambda core: _everywhere(core, core.vmin),
        lambda limit: limit != -VOLTAGE_MAX,
        f"Lava clips potentials at {-VOLTAGE_MAX} alone",
        f"Give its neurons a vmin of {-VOLTAGE_MAX}, or emit another kind.",
    ),
    Rule(
        "vmax",
        lambda core: _everywhere(core, core.vmax),
        lambda limit: limit != VOLTAGE_MAX,
        f"Lava clips potentials at {VOLTAGE_MAX} alone",
        f"Give its neurons a vmax of {VOLTAGE_MAX}, or emit another kind.",
    ),
)


def check_fits(played: Played) -> None:
    """Raise InputError for settings, synapses and values in the recording that Lava does not play alike."""
    for core in played.program.cores:
        for rule in RULES:
            _check_setting(core, rule)
        _check_exponents(core)
    for phase in played.phases:
        for group in played.program.columns_of(phase.name):
            _check_registers(played, phase.name, group)


def _check_setting(core: Core, rule: Rule) -> None:
    """Raise InputError if a compartment of the core breaks a rule; the error names the population of the first."""
    values = rule.value(core)
    refused = np.flatnonzero(rule.breaks(values))
    if refused.size:
        compartment = int(refused[0])
        measured = f"{rule.setting} {values[compartment]}"
        where = f"{WHERE}, population {_group_of(core, compartment)!r}"
        raise InputError(where, rule.what, measured=measured, fix=rule.fix)


def _check_exponents(core: Core) -> None:
    """Raise InputError for negative exponents: Lava rounds a sum of weights, and a core rounds each weight."""
    axons = core.axons
    exponent_of_format = np.array([form.exponent for form in axons.formats], dtype=np.int64)
    exponents = exponent_of_format[axons.format_index]
    refused = np.flatnonzero(exponents < 0)
    if refused.size:
        synapse = int(refused[0])
        where = f"{WHERE}, synapses onto {_group_of(core, int(axons.target[synapse]))!r}"
        what = "Lava rounds with a negative exponent in another way"
        fix = "Scale weights, biases and thresholds up, or emit another kind."
        raise InputError(where, what, measured=f"exponent {exponents[synapse]}", fix=fix)


def _check_registers(played: Played, phase: str, group: str) -> None:
    """Raise InputError if a register of the group takes a value in the recording from which Lava goes on otherwise."""
    where = f"{WHERE}, population {group!r}"
    fix = "Show another one by --recording, or emit another kind."
    events = played.result.events.get(group, {})
    wraps = events.get("charge_wraps", 0) + events.get("current_wraps", 0)
    if wraps:
        what = "registers wrap in this recording, and Lava's wrap in another way"
        raise InputError(where, what, measured=counted(wraps, "wrap"), fix=fix)
    lowest_current = int(played.recorded(phase, "u", group).min(initial=0))
    if lowest_current <= -CURRENT_LIMIT:
        what = "a current has the one value of this recording that Lava turns round"
        raise InputError(where, what, measured=f"u = {lowest_current}", fix=fix)


def _group_of(core: Core, compartment: int) -> str:
    """Return the population that a compartment of a core belongs to."""
    return core.slices[int(core.slice_of_compartment[compartment])].group
