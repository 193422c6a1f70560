"""Why the first spike that differs does: what each stage adds to the potential that decided it."""

from collections.abc import Mapping

from hw_model.values import ByteArray, Frozen
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.error_budget.stages import STAGES, Stage, lines_of, phases_of, twin_with, working
from locsnn_compile.verification.error_budget.twin import run_twins
from locsnn_compile.verification.matching import Divergence


class Cause(Frozen, eq=False):
    """The difference of the two potentials at the first spike that differs, taken apart.

    Until then all spikes are equal, so each stage can be judged by itself: ``moved[stage]`` is how far it alone moves
    the float potential, in the float network's units, and ``together`` how far all stages do. ``enough`` lists the
    stages that alone make the neuron decide as the chip does. Stages that change no number are not listed.
    """

    moved: Mapping[Stage, float]
    together: float
    enough: tuple[Stage, ...]

    @property
    def rest(self) -> float:
        """What the stages do only in each other's presence."""
        return self.together - sum(self.moved.values())

    @property
    def largest(self) -> Stage:
        """The stage that moves the potential furthest in the direction of the difference."""
        return max(self.moved, key=lambda stage: self.moved[stage] if self.together >= 0 else -self.moved[stage])


def find_cause(levels: Levels, recording: ByteArray, first: Divergence) -> Cause:
    """Explain the first divergence in ``recording`` (steps, channels), of the network's own steps and channels."""
    network, phases = levels.network, phases_of(levels)
    name = next(p.phase for p in network.populations if p.name == first.population)
    phase = next(phase for phase in phases if phase.name == name)
    until = slice(0, first.step + 1)
    lines = {name: played[:, until] for name, played in lines_of(network, phase, recording[None]).items()}
    reference = evaluate(network, recording[None], registers=phase.registers).spikes
    equal = {name: spikes[:, until] for name, spikes in reference.items()}
    scale = float(levels.quantized.population(first.population).scale[first.neuron])

    stages = [stage for stage in STAGES if working(phases, stage)]
    variants = [(), stages, *([stage] for stage in stages)]
    twins = [twin_with(phase, variant) for variant in variants]
    traces = run_twins(twins, lines, forced=equal, potentials=(first.population,))
    at = (0, first.step, first.neuron)
    # By variant the potential in float units, and whether the neuron spikes.
    (exact, _), (chip, fires), *others = (
        (float(trace.potential[first.population][at]) / scale, bool(trace.spikes[first.population][at]))
        for trace in traces
    )
    alone = dict(zip(stages, others, strict=True))
    return Cause(
        moved={stage: potential - exact for stage, (potential, _) in alone.items()},
        together=chip - exact,
        enough=tuple(stage for stage, (_, decision) in alone.items() if decision == fires),
    )
