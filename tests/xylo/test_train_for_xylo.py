"""Networks that are trained in the integers of a Xylo: their steps are the chip's, and nothing is rounded afterwards.

Independent answers: spikes and registers of a second implementation in plain Python (``xylo_oracle``), and gradients by
PyTorch's automatic differentiation of the equations (``by_equations``).
"""

from __future__ import annotations

import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import locsnn_compile as lc
from hw_model.xylo.playing import rows_of
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription, XyloParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.models.xylo_entry import XyloNumbers, XyloSynapses
from locsnn_compile.models.xylo_network import XyloSnn, network_of_integers
from locsnn_compile.network.network import Network
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.train import train
from tests.support.xylo_oracle import play

CHANNELS = 7
STEPS = 24
CLASSES = 3
HIDDEN = 9
SEEDS = range(12)
"""Seeds of random models. Among them are some in which neurons spike 31 times in a step, and some in which none does."""


def description(neuron: XyloParameters, hidden: int = HIDDEN) -> NetworkDescription:
    """Return the description of a network of a hidden layer and outputs."""
    layout = InputLayout(SensorLayout("channels", CHANNELS, polarities=1, surfaces=1), STEPS, 0.01)
    return NetworkDescription("xylo-snn", layout, CLASSES, hidden=hidden, neuron=neuron)


def random_numbers(r: np.random.Generator) -> XyloNumbers:
    """Return random thresholds and shifts: with some hardly anything spikes, with others registers saturate."""
    hidden_threshold, output_threshold = (int(r.choice([60, 900, 20_000])) for _ in range(2))
    names = ("time_hidden", "time_recurrent", "time_output")
    thresholds = (hidden_threshold, hidden_threshold, output_threshold)
    synapses = {}
    for name, threshold in zip(names, thresholds, strict=True):
        shift = int(r.choice([0, 3, 7]))
        synapses[name] = XyloSynapses(shift, 2**shift / threshold)
    return XyloNumbers("xylo-audio3", hidden_threshold, output_threshold, synapses)


def random_model(seed: int) -> XyloSnn:
    """Return a model with random dashes (decays), thresholds, shifts and integer weights."""
    r = np.random.default_rng(seed)
    # Two different dashes for currents and for potentials, each pair ascending.
    dashes_syn = sorted(r.choice(np.arange(1, 9), 2, replace=False).tolist())
    dashes_mem = sorted(r.choice(np.arange(1, 9), 2, replace=False).tolist())
    neuron = XyloParameters(tuple(dashes_syn), tuple(dashes_mem))
    model = build_network(description(neuron), seed=seed, chip=random_numbers(r))
    assert isinstance(model, XyloSnn)
    mantissas = {
        name: r.integers(-127, 128, shape)
        for name, shape in model.description.weight_shapes.items()
    }
    model.load_weights(model.xylo.floats(mantissas))
    return model


def touches(seed: int, samples: int = 4) -> np.ndarray:
    """Return random recordings (samples, steps, channels)."""
    r = np.random.default_rng(seed + 100)
    return (r.random((samples, STEPS, CHANNELS)) < 0.3).astype(np.uint8)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_spike_and_register_of_the_forward_pass_is_that_of_the_arithmetic(seed):
    model = random_model(seed)
    recordings = touches(seed)
    mantissas = model.mantissas()
    network = network_of_integers(model.neuron, model.xylo, mantissas)

    with torch.no_grad():
        activity = model(torch.from_numpy(recordings).float())
    played = model.play(torch.from_numpy(recordings).double(), mantissas)

    for number, recording in enumerate(recordings):
        expected, _ = play(network, rows_of(recording))
        assert (activity["time_hidden"][number].numpy() == expected["spikes"]).all()
        assert (activity["time_output"][number].numpy() == expected["output_spikes"]).all()
        # The model's potentials are those before the spikes, in thresholds.
        threshold = model.xylo.hidden_threshold
        before_spikes = expected["v"] + expected["spikes"] * threshold
        assert (played.hidden_potential[number].numpy() == before_spikes / threshold).all()


def test_hidden_neurons_spike_several_times_in_a_step():
    """Some of the random models must do this, which distinguishes a Xylo, or the comparison would show little."""
    most_spikes = []
    with torch.no_grad():
        for seed in SEEDS:
            activity = random_model(seed)(torch.from_numpy(touches(seed)).float())
            most_spikes.append(float(activity["time_hidden"].max()))
    assert max(most_spikes) == 31
    assert min(most_spikes) < 31


def by_equations(
    model: XyloSnn, x: torch.Tensor, of_hidden: torch.Tensor, of_outputs: torch.Tensor
):
    """Return the gradients of all weights by automatic differentiation of the equations.

    ``of_hidden`` and ``of_outputs`` are the gradients of the loss by the spikes. Surrogate slopes are taken at the
    potentials of the chip, and spikes have the chip's values.
    """
    played = model.play(x, model.mantissas())
    floats = model.xylo.floats(model.mantissas())
    weights_in, weights_among, weights_out = (
        torch.from_numpy(floats[name]).requires_grad_() for name in model.names
    )
    dashes = model.neuron.hidden_dashes(model.description.hidden)
    # The shares that a step keeps of currents and potentials.
    kept_i = torch.from_numpy(1 - 0.5 ** dashes.syn.astype(float))
    kept_v = torch.from_numpy(1 - 0.5 ** dashes.mem.astype(float))
    kept_i_out = 1 - 0.5**model.neuron.output_dash_syn
    kept_v_out = 1 - 0.5**model.neuron.output_dash_mem
    shape = (len(x), model.description.hidden)
    i, v, spikes = (torch.zeros(shape, dtype=torch.float64) for _ in range(3))
    i_out, v_out = (torch.zeros((len(x), CLASSES), dtype=torch.float64) for _ in range(2))
    loss = torch.zeros((), dtype=torch.float64)
    for t in range(STEPS):
        # Outputs first, since they get the hidden spikes of the step before.
        i_out = kept_i_out * (i_out + spikes @ weights_out.T)
        v_out = kept_v_out * v_out + i_out
        output = v_out * slope_at(played.output_potential[:, t], model.neuron.window)
        v_out = v_out - output
        i = kept_i * (i + played.rows[:, t] @ weights_in.T + spikes @ weights_among.T)
        v = kept_v * v + i
        drive = v * slope_at(played.hidden_potential[:, t], model.neuron.window)
        v = v - drive
        # The value is the chip's, and the gradient that of the drive.
        spikes = played.hidden[:, t] + drive - drive.detach()
        loss = loss + (spikes * of_hidden[:, t]).sum() + (output * of_outputs[:, t]).sum()
    loss.backward()
    return weights_in.grad, weights_among.grad, weights_out.grad


def slope_at(potential: torch.Tensor, window: float) -> torch.Tensor:
    """Return the surrogate slope: 1 from the threshold on, and an exponential of this ``window`` below."""
    return torch.where(potential < 1, torch.exp((potential - 1) / window), torch.ones(()).double())


@pytest.mark.parametrize("seed", SEEDS[:4])
def test_the_gradient_is_that_of_leaky_neurons_at_the_chips_potentials(seed):
    model = random_model(seed).double()
    x = torch.from_numpy(touches(seed)).double()
    r = torch.Generator().manual_seed(seed)
    of_hidden = torch.randn((len(x), STEPS, HIDDEN), generator=r, dtype=torch.float64)
    of_outputs = torch.randn((len(x), STEPS, CLASSES), generator=r, dtype=torch.float64)

    activity = model(x)
    loss = (activity["time_hidden"] * of_hidden).sum() + (
        activity["time_output"] * of_outputs
    ).sum()
    loss.backward()

    for name, expected in zip(
        model.names, by_equations(model, x, of_hidden, of_outputs), strict=True
    ):
        torch.testing.assert_close(model.weight(name).grad, expected, rtol=1e-9, atol=1e-6)


def bands(samples: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Return recordings (samples, 30, 8) of two classes with their labels: each class has four busy channels."""
    r = np.random.default_rng(3)
    labels = np.arange(samples) % 2
    rate = np.full((samples, 1, 8), 0.02)
    rate[labels == 0, :, :4] = 0.3
    rate[labels == 1, :, 4:] = 0.3
    return (r.random((samples, 30, 8)) < rate).astype(np.uint8), labels


OPTIONS = {
    "target": "xylo-imu",
    "channels": 8,
    "hidden": 12,
    "epochs": 12,
    "batch_size": 8,
    "learning_rate": 0.03,
    "dash_mem": "3 5",
}


def test_what_a_batch_keeps_for_its_gradient_is_given_back():
    model = random_model(1)
    x = torch.from_numpy(np.ones((2, STEPS, CHANNELS), np.float32))
    activity = model(x)
    # The node of PyTorch's graph keeps what its backward pass needs.
    graph_node = weakref.ref(activity["time_output"].grad_fn)
    assert graph_node() is not None
    activity["time_output"].sum().backward()
    del activity
    assert graph_node() is None


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """The checkpoint of a network that was trained on two classes."""
    spikes, labels = bands()
    path = tmp_path_factory.mktemp("trained") / "bands.pt"
    lc.train(spikes, OPTIONS, labels=labels).save(path)
    return path


@pytest.mark.slow
def test_a_network_learns_in_the_integers_of_a_xylo(trained):
    checkpoint = read_checkpoint(trained)
    assert checkpoint.description.architecture == "xylo-snn"
    assert checkpoint.training["validation_accuracy"] == 1.0


def test_weights_among_hidden_neurons_learn_at_a_twentieth_of_the_rate(tmp_path):
    spikes, labels = bands(8)
    config = config_from_mapping(OPTIONS | {"epochs": 2, "schedule": "constant", "refit": False})

    state_path = tmp_path / "run.state"
    train(Recordings(spikes, labels, 0.01, "bands"), config, state_path=state_path, save_every=1)

    groups = torch.load(state_path, weights_only=True)["optimizer"]["param_groups"]
    # Onto hidden neurons and outputs at the rate itself, among hidden neurons more slowly.
    assert [(group["lr"], len(group["params"])) for group in groups] == [
        (0.03, 2),
        (pytest.approx(0.0015), 1),
    ]


def test_the_program_has_the_integers_of_the_checkpoint(trained):
    checkpoint = read_checkpoint(trained)
    spikes, labels = bands()

    compiled = lc.compile(lc.load(trained), target="xylo-imu", events=spikes, labels=labels)

    program = compiled.program.network
    assert (program.weights_in[:, :, 0].T == checkpoint.weights["time_hidden"]).all()
    assert (program.weights_hidden[:, :, 0].T == checkpoint.weights["time_recurrent"]).all()
    assert (program.weights_out.T == checkpoint.weights["time_output"]).all()
    assert (program.hidden.threshold == checkpoint.xylo.hidden_threshold).all()
    assert (program.outputs.dash_mem == 5).all()
    assert program.hidden.dash_mem.tolist() == [3, 5] * 6
    matches = compiled.match.by_population.values()
    assert all(match.mismatches == 0 for match in matches)
    assert sum(match.chip_spikes for match in matches) > 0
    assert compiled.figures.accuracy.chip == 1.0


def test_fine_tuning_starts_at_the_same_integers(trained, tmp_path):
    """Weights that are loaded into a model in float round to the integers of the checkpoint."""
    checkpoint = read_checkpoint(trained)
    chip = checkpoint.xylo
    network = build_network(checkpoint.description, chip=chip)
    network.load_weights(checkpoint.float_weights)
    for name, mantissas in network.mantissas().items():
        assert (mantissas == checkpoint.weights[name]).all()


def test_a_checkpoint_is_read_as_it_was_written(trained, tmp_path):
    checkpoint = read_checkpoint(trained)
    checkpoint.save(tmp_path / "again.pt")
    assert (tmp_path / "again.pt").read_bytes() == trained.read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            {"model": "hybrid"},
            "training option 'model': xylo-imu has no neurons like those of 'hybrid'. Give xylo-snn.",
            id="another network",
        ),
        pytest.param(
            {"model": "xylo-snn", "target": "float"},
            "training option 'target': 'xylo-snn' exists in the integers of a Xylo only (got float). "
            "Give xylo-audio2, xylo-audio3 or xylo-imu.",
            id="in float",
        ),
        pytest.param(
            {"weight_bits": 6},
            "training option 'weight_bits': weights of xylo-imu have one width (6 against 8). Leave it "
            "out.",
            id="other weights",
        ),
        pytest.param(
            {"hidden": 497},
            "target 'xylo-imu': too many hidden neurons (497 against 496). Give fewer (--hidden).",
            id="hidden neurons",
        ),
        pytest.param(
            {"dash_syn": "0 2"},
            "neuron 'dash_syn': they must be numbers of bits to shift by, each larger than the one "
            "before (got [0, 2] against 1..15). Give, for example, 2 4.",
            id="a current that keeps nothing",
        ),
        pytest.param(
            {"align_events": 1},
            "training option 'align_events': xylo-imu starts with the recording. Leave it out.",
            id="aligned recordings",
        ),
    ],
)
def test_what_no_xylo_can_be_trained_for_is_refused(options, message):
    spikes, labels = bands(8)
    with pytest.raises((lc.InputError, lc.TargetError)) as error:
        lc.train(spikes, OPTIONS | options, labels=labels)
    assert str(error.value) == message


def test_recordings_of_too_many_channels_are_refused_before_training():
    spikes = np.ones((4, 10, 17), np.uint8)
    with pytest.raises(lc.TargetError) as error:
        lc.train(spikes, OPTIONS | {"channels": 17}, labels=[0, 1, 0, 1])
    assert str(error.value) == (
        "target 'xylo-imu': too many inputs (17 against 16). Merge polarities (--merge-polarities), or "
        "neighbours (--merge-channels 16)."
    )


def test_more_classes_than_outputs_are_refused():
    spikes = np.ones((9, 10, 8), np.uint8)
    with pytest.raises(lc.TargetError) as error:
        lc.train(spikes, OPTIONS | {"target": "xylo-audio2"}, labels=np.arange(9))
    assert str(error.value) == (
        "target 'xylo-audio2': too many outputs (9 against 8). Give fewer classes."
    )


def test_mantissas_beyond_8_bits_are_refused(trained, tmp_path):
    checkpoint = read_checkpoint(trained)
    wide = {name: np.array(weights) for name, weights in checkpoint.weights.items()}
    wide["time_output"][1, 2] = 128
    with pytest.raises(lc.InputError) as error:
        replace(checkpoint, weights=wide).save(tmp_path / "wide.pt")
    assert str(error.value) == (
        "population 'time_output': mantissa [1, 2] is not on the grid of 8 bits (got 128, 1 such "
        "mantissas). Train the network again."
    )


def test_a_xylo_network_is_a_network_like_any_other(trained):
    network = lc.load(trained)
    assert isinstance(network, Network)
    assert [p.name for p in network.populations] == ["time_hidden", "time_output"]
    assert isinstance(read_checkpoint(trained), Checkpoint)
