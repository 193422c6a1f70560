"""Networks that learn in the integers of a Xylo: their steps are the chip's, and nothing is rounded after them."""

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
SEEDS = range(12)


def description(neuron: XyloParameters, hidden: int = 9) -> NetworkDescription:
    layout = InputLayout(SensorLayout("channels", CHANNELS, 1, 1), STEPS, 0.01)
    return NetworkDescription("xylo-snn", layout, CLASSES, hidden=hidden, neuron=neuron)


def random_numbers(r: np.random.Generator) -> XyloNumbers:
    """Thresholds and shifts from those at which hardly anything spikes to those at which registers saturate."""
    hidden, output = (int(r.choice([60, 900, 20_000])) for _ in range(2))
    names = ("time_hidden", "time_recurrent", "time_output")
    thresholds = (hidden, hidden, output)
    synapses = {}
    for name, threshold in zip(names, thresholds, strict=True):
        shift = int(r.choice([0, 3, 7]))
        synapses[name] = XyloSynapses(shift, 2**shift / threshold)
    return XyloNumbers("xylo-audio3", hidden, output, synapses)


def random_model(seed: int) -> XyloSnn:
    r = np.random.default_rng(seed)
    rising = [sorted(r.choice(np.arange(1, 9), 2, replace=False).tolist()) for _ in range(2)]
    neuron = XyloParameters(tuple(rising[0]), tuple(rising[1]))
    model = build_network(description(neuron), seed=seed, chip=random_numbers(r))
    assert isinstance(model, XyloSnn)
    mantissas = {
        name: r.integers(-127, 128, shape)
        for name, shape in model.description.weight_shapes.items()
    }
    model.load_weights(model.xylo.floats(mantissas))
    return model


def touches(seed: int, samples: int = 4) -> np.ndarray:
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
        before = expected["v"] + expected["spikes"] * model.xylo.hidden_threshold
        assert (
            played.hidden_potential[number].numpy() == before / model.xylo.hidden_threshold
        ).all()


def test_hidden_neurons_spike_several_times_in_a_step():
    """Of the random networks above, some must do what distinguishes a Xylo, or they would show little."""
    with torch.no_grad():
        most = [
            float(random_model(seed)(torch.from_numpy(touches(seed)).float())["time_hidden"].max())
            for seed in SEEDS
        ]
    assert max(most) == 31
    assert min(most) < 31


def by_equations(
    model: XyloSnn, x: torch.Tensor, of_hidden: torch.Tensor, of_outputs: torch.Tensor
):
    """The gradients of the equations by automatic differentiation, at the potentials and spikes of the chip."""
    played = model.play(x, model.mantissas())
    floats = model.xylo.floats(model.mantissas())
    into, among, onto = (torch.from_numpy(floats[name]).requires_grad_() for name in model.names)
    dashes = model.neuron.hidden_dashes(model.description.hidden)
    kept_i, kept_v = (
        torch.from_numpy(1 - 0.5 ** d.astype(float)) for d in (dashes.syn, dashes.mem)
    )
    out_i, out_v = (
        1 - 0.5**d for d in (model.neuron.output_dash_syn, model.neuron.output_dash_mem)
    )
    shape = (len(x), model.description.hidden)
    i, v, s = (torch.zeros(shape, dtype=torch.float64) for _ in range(3))
    oi, ov = (torch.zeros((len(x), CLASSES), dtype=torch.float64) for _ in range(2))
    loss = torch.zeros((), dtype=torch.float64)
    for t in range(STEPS):
        oi = out_i * (oi + s @ onto.T)
        ov = out_v * ov + oi
        output = ov * slope_at(played.output_potential[:, t], model.neuron.window)
        ov = ov - output
        i = kept_i * (i + played.rows[:, t] @ into.T + s @ among.T)
        v = kept_v * v + i
        drive = v * slope_at(played.hidden_potential[:, t], model.neuron.window)
        v = v - drive
        # The value is the chip's, and the gradient that of the drive.
        s = played.hidden[:, t] + drive - drive.detach()
        loss = loss + (s * of_hidden[:, t]).sum() + (output * of_outputs[:, t]).sum()
    loss.backward()
    return into.grad, among.grad, onto.grad


def slope_at(potential: torch.Tensor, window: float) -> torch.Tensor:
    return torch.where(potential < 1, torch.exp((potential - 1) / window), torch.ones(()).double())


@pytest.mark.parametrize("seed", SEEDS[:4])
def test_the_gradient_is_that_of_leaky_neurons_at_the_chips_potentials(seed):
    model = random_model(seed).double()
    x = torch.from_numpy(touches(seed)).double()
    r = torch.Generator().manual_seed(seed)
    of_hidden = torch.randn((len(x), STEPS, 9), generator=r, dtype=torch.float64)
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
    """Recordings of two classes, of which each is loud in channels of its own."""
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
    steps = weakref.ref(activity["time_output"].grad_fn)
    assert steps() is not None
    activity["time_output"].sum().backward()
    del activity
    assert steps() is None


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
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
    """With a learning rate of almost 0, training ends where it began."""
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
