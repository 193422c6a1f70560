"""Tables of the page on networks beyond the two that are measured: the best networks on larger cores, and a ranking of settings."""

import numpy as np
import plans
import repeats
import runs
from page_text import table

import hw_model as hw
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower

PLAYED = {"containers-best": ("Containers", 20), "objects-best": ("Objects", 1)}
"""Networks on a core of their own: the set and how many of its test recordings are played at gate level."""


def larger(files: runs.Library) -> list[tuple[str, ...]]:
    """Return rows on the best networks, each on a core that is large enough, with memories chosen by the same search.

    Each plays test recordings at gate level; class and number of operations must equal the simulator's.
    """
    rows = []
    for model, (dataset, recording_count) in PLAYED.items():
        program, recordings = runs.compiled(model), runs.real(dataset, "test", recording_count)
        mapped, core = runs.holding(program, recordings.shape[1])
        needs, memory_traffic = (
            mapped.needs,
            repeats.parts_of(runs.counted_for(program, recordings, core), mapped, core.sizes),
        )
        chosen = plans.plan(files, plans.PRICE, core, memory_traffic)
        built = runs.Built(files, chosen, gated=True, core=core)
        played = built.play(program, runs.stacked(program, recordings))
        simulated = hw.simulate(program, recordings, probe=())
        assert (played.answers[:, 0] == simulated.prediction).all()
        assert (
            played.answers[:, 2] == [counted.synaptic_ops for counted in simulated.per_recording]
        ).all()
        energy = built.energy(played, "modelled")
        memory_pj, logic = (
            energy.of("memory").mean(),
            (energy.of("logic") + energy.of("clock")).mean(),
        )
        counts = sum(simulated.per_recording, hw.Counts())
        area, ops = (
            sum(plans.area(files, counted) for counted in chosen),
            counts.synaptic_ops / recording_count,
        )
        rows.append((
            f"`{model}`", str(recording_count), f"{needs.synapses:,}", f"{needs.compartments:,}", f"{area / 1e6:.1f}", f"{ops:,.0f}",
            f"{counts.neuron_updates / recording_count:,.0f}", f"{memory_pj / 1e6:.1f}", f"{logic / 1e6:.1f}",
            f"{(memory_pj + logic) / ops:.0f}",
        ))  # fmt: skip
    return rows


def ranking() -> str:
    """Return a table of strategies and weight bits, by the profile of this page and by ``davies2018``."""
    ours, theirs = (
        hw.chip("locsnn-130nm").profile("ihp-sg13g2"),
        hw.chip("loihi-sim").profile("davies2018"),
    )
    network = load(runs.ROOT / "examples/models/objects-hybrid.pt")
    recordings = np.load(runs.ROOT / "examples/recordings/touches.npz")["spikes"].transpose(0, 2, 1)
    rows, by_profile = [], []
    for bits in (4, 8):
        for strategy in ("reset", "delay-line", "dendrite", "paired-dendrite"):
            program = lower(network, hw.chip("loihi-sim"), bits, strategy).program
            counts = hw.simulate(program, recordings, probe=()).counts
            uj = [
                sum(hw.energy_pj(counts, one).values()) / len(recordings) / 1e6
                for one in (theirs, ours)
            ]
            by_profile.append(uj)
            op_counts = (counts.synaptic_ops, counts.neuron_updates)
            rows.append(
                (
                    f"{strategy}, {bits}-bit",
                    *(f"{x:.1f}" for x in uj),
                    *(f"{n / len(recordings):,.0f}" for n in op_counts),
                )
            )
    same_order = (
        np.argsort([a for a, _ in by_profile]) == np.argsort([b for _, b in by_profile])
    ).all()
    costs = []
    for one in (ours, theirs):
        pj = one.energy_pj
        rest, active = (
            pj.get("neuron_updates", 0.0) + pj.get(f"neuron_updates_{name}", 0.0)
            for name in ("inactive", "active")
        )
        op = pj["synaptic_ops"]
        costs.append((active / op, rest / op))
    table_text = table(
        ("setting", "µJ, davies2018", "µJ, ihp-sg13g2", "synaptic operations", "updates"), rows
    )
    order = "is the same" if same_order else "is another"
    (active, rest), (davies_active, davies_rest) = costs
    return (
        f"{table_text}\nThe order {order}. Here an active update costs as much as {active:.1f} synaptic operations, and one at rest as "
        f"{rest:.1f};\nby `davies2018` these are {davies_active:.1f} and {davies_rest:.1f}.\n"
    )
