"""A small network, recordings for it, and explorations of it from the command line."""

import json
import os

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster

from locsnn_compile.cli.main import main
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.typed import typed
from locsnn_compile.settings import DIALS, Setting

STEPS = 40


def figures_of(build):
    """The figures of a build, as its report.json has them."""
    document = json.loads((build / "report.json").read_text())
    return Figures.of(typed(ReportFigures, document))


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    """A time branch of random weights that spikes on random events."""
    description = NetworkDescription(
        "tactile-snn",
        InputLayout(neutouch(1), STEPS, step_seconds=0.02),
        classes=3,
        hidden=6,
        name="small",
    )
    r = np.random.default_rng(0)
    weights = {
        name: r.normal(0.5, 2.0, shape).astype(np.float32)
        for name, shape in description.weight_shapes.items()
    }
    path = tmp_path_factory.mktemp("model") / "small.pt"
    Checkpoint(description, weights).save(path)
    return path


@pytest.fixture(scope="session")
def events(tmp_path_factory):
    return labelled(tmp_path_factory.mktemp("events") / "few.npz", seed=1)


@pytest.fixture(scope="session")
def divided(tmp_path_factory):
    """A folder of recordings with a train and a test part."""
    folder = tmp_path_factory.mktemp("divided") / "touches"
    r = np.random.default_rng(2)
    for part, many in (("train", 6), ("test", 4)):
        (folder / part).mkdir(parents=True)
        for i in range(many):
            touch = (r.random((39, 2, STEPS)) < 0.2).astype(np.float32)
            np.save(folder / part / f"sample_{i}_label_{i % 3}.npy", touch)
    return folder


@pytest.fixture(scope="session")
def cluster():
    """Two workers of this machine, each a process that is started again when it dies.

    Whoever asks a dead one for a result would wait for an answer for half a minute.
    """
    soon = dask.config.set({"distributed.comm.timeouts.connect": "5s"})
    with (
        soon,
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as made,
    ):
        yield made


def workers_of(cluster):
    with Client(cluster.scheduler_address, set_as_default=False) as client:
        return list(client.run(os.getpid).values())


def labelled(path, *, seed, many=5):
    r = np.random.default_rng(seed)
    np.savez(
        path,
        spikes=(r.random((many, 78, STEPS)) < 0.2).astype(np.uint8),
        labels=np.arange(many) % 3,
    )
    return path


def explore(*arguments):
    return main(["explore", *map(str, arguments)])


def narrow(*strategies, bits=(8,)):
    """Options of a grid of some strategies and weight bits; every other dial has its neutral value."""
    others = [text for dial in DIALS[2:] for text in (dial.option, dial.neutral)]
    return ["--strategy", *strategies, "--weight-bits", *bits, *others]


def setting(strategy, bits):
    """A setting whose other values are neutral."""
    return Setting(strategy, bits, *(dial.neutral for dial in DIALS[2:]))


def explored(folder):
    return json.loads((folder / "explore.json").read_text())


def lasting(folder):
    """The files that must not depend on where and when points were measured."""
    return {
        name: (folder / name).read_bytes()
        for name in ("explore.json", "explore.csv", "explore.svg")
    }


def figures(spikes=0.9, predictions=1.0, energy=1e6, time=1e6, scores=0.0):
    return Figures(
        prediction_agreement=predictions,
        spike_agreement=spikes,
        score_error=scores,
        accuracy=None,
        float_accuracy=None,
        energy_profile="davies2018",
        energy_pj=energy,
        chip_time_ns=time,
        cores=1,
        compartments=10,
        synapses=100,
        synapse_bits=800,
        wraps=0,
        clips=0,
    )


def point(name="dendrite", bits=8, found=None, refusal=None, timings=None):
    return Point(
        setting(name, bits),
        None if refusal else found or figures(),
        refusal,
        timings or {},
        "1+code",
    )
