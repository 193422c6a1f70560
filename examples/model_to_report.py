"""From a trained model to a checked program and its figures, in Python.

The same from the command line: ``locsnn-compile examples/models/objects-hybrid.pt --events ...``.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import hw_model as hw
import locsnn_compile as lc

examples = Path(__file__).parent
network = lc.load(examples / "models" / "objects-hybrid.pt")
compiled = lc.compile(
    network, target="loihi-sim", weight_bits=8, events=examples / "recordings" / "touches.npz"
)

match, energy = compiled.report["match"], compiled.report["energy"]
print(f"{network.name}: {match['samples']} recordings from {match['events_source']}")
print(f"  same class as the float network: {match['prediction_agreement']:.1%}")
print(f"  spikes at the same neuron and step: {match['spike_agreement']:.1%}")
print(
    f"  energy of a recording: {energy['per_sample_pj'] / 1e6:.2f} µJ (profile {energy['profile']})"
)

with TemporaryDirectory() as folder:
    compiled.program.save(folder)
    program = hw.load_program(folder)
recordings = lc.read_recordings(examples / "recordings" / "touches.npz")
result = hw.simulate(program, recordings.spikes)
print(f"  classes on the chip: {result.prediction.tolist()}")
