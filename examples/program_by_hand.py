"""Write a chip program by hand, run it with both engines, and price what it did.

Two inputs drive a CUBA neuron that charges slowly and rests three steps after each spike; an inhibitory neuron
answers its spikes two steps later.
"""

import numpy as np

import hw_model as hw

chip = hw.chip("loihi-sim")
builder = hw.ProgramBuilder(chip, name="answer")
touch = builder.add_input("touch", 2)
charger = builder.add_compartments(
    "charger", 1, decay_u=1024, decay_v=128, threshold=400, refractory=4
)
answer = builder.add_compartments("answer", 1, decay_u=4096, decay_v=4096, threshold=50)
builder.connect(touch, charger, [[100, 40]])
builder.connect(charger, answer, [[60]], delay=1)
builder.connect(answer, charger, [[-80]], sign_mode="inhibitory")
program = builder.build()

rng = np.random.default_rng(seed=1)
spikes = (rng.random((40, 2)) < 0.5).astype(np.uint8)
result = hw.simulate(program, spikes, probe=("spikes", "v"))
slow = hw.simulate(program, spikes, engine="reference", probe=("spikes", "v"))
assert np.array_equal(result.v["charger"], slow.v["charger"])

print("charger spikes at steps", np.flatnonzero(result.spikes["charger"]).tolist())
print("answer  spikes at steps", np.flatnonzero(result.spikes["answer"]).tolist())
print(
    "synaptic operations",
    result.counts.synaptic_ops,
    "- neuron updates",
    result.counts.neuron_updates,
)
profile = chip.profile("davies2018")
print(f"energy {sum(hw.energy_pj(result.counts, profile).values()):.1f} pJ ({profile.source})")
