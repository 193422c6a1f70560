"""The energy, time and operations that stopping recordings early saves."""

import math

import hw_model as hw
from hw_model.values import Frozen


class Savings(Frozen):
    """Means per recording, until it stops and for the whole recording (``all_``), by the default profile.

    Latency is None if the target has no times of single steps, energy if it has no profile.
    """

    steps: float
    all_steps: float
    synaptic_ops: float
    all_synaptic_ops: float
    energy_pj: float | None
    all_energy_pj: float | None
    latency_ns: float | None
    all_latency_ns: float | None
    profile: str | None


def savings(program: hw.ChipProgram, stops: hw.Stops) -> Savings:
    """Return the means per recording of a program, given where its recordings stop."""
    from hw_model.targets import target_of  # slow to import, and users of the type do not need it

    chip = program.chip
    batch = len(stops.steps)
    target = target_of(chip)
    timed = target.timed and target.times_cores
    priced = bool(chip.profiles)
    return Savings(
        steps=float(stops.steps.mean()),
        all_steps=float(stops.all_steps),
        synaptic_ops=stops.counts.synaptic_ops / batch,
        all_synaptic_ops=stops.all_counts.synaptic_ops / batch,
        energy_pj=_mean_pj(stops.counts, chip, batch) if priced else None,
        all_energy_pj=_mean_pj(stops.all_counts, chip, batch) if priced else None,
        latency_ns=stops.latency_ns / batch if timed else None,
        all_latency_ns=stops.all_latency_ns / batch if timed else None,
        profile=chip.default_profile,
    )


def _mean_pj(counts: hw.Counts, chip: hw.Chip, batch: int) -> float:
    """Return the mean energy of ``batch`` recordings whose counts are added up."""
    return math.fsum(hw.energy_pj(counts, chip.costs).values()) / batch
