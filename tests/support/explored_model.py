"""A small network, recordings for it, and helpers to explore it from the command line.

``locsnn explore`` compiles a network with every combination (setting) of strategy, weight bits and other dials, and
measures each as a point.
"""

import json
import logging
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

OTHER_DIALS = DIALS[2:]
"""All dials but the strategy and the weight bits, which come first."""

STEPS = 40
TAXELS = 39
"""Touch-sensitive points of one fingertip of the NeuTouch sensor; each has a channel per polarity."""
CHANNELS = 2 * TAXELS


def figures_of(build):
    """Return the figures of a compiled network from the report.json in its folder."""
    document = json.loads((build / "report.json").read_text())
    return Figures.of(typed(ReportFigures, document))


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    """Path of a network of the time branch only, whose random weights make it spike on random events."""
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
    """Path of a file of five labelled recordings."""
    return labelled(tmp_path_factory.mktemp("events") / "few.npz", seed=1)


@pytest.fixture(scope="session")
def divided(tmp_path_factory):
    """Path of a folder of recordings with a train and a test part."""
    folder = tmp_path_factory.mktemp("divided") / "touches"
    r = np.random.default_rng(2)
    for part, count in (("train", 6), ("test", 4)):
        (folder / part).mkdir(parents=True)
        for i in range(count):
            touch = (r.random((TAXELS, 2, STEPS)) < 0.2).astype(np.float32)
            np.save(folder / part / f"sample_{i}_label_{i % 3}.npy", touch)
    return folder


@pytest.fixture(scope="session")
def cluster():
    """Two Dask workers on this machine, each a process that is started again when it dies.

    Connections time out after 5 s, since a task that needs a result of a dead worker would wait for half a minute.
    """
    short_timeout = dask.config.set({"distributed.comm.timeouts.connect": "5s"})
    with (
        short_timeout,
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as local_cluster,
    ):
        yield local_cluster


def workers_of(cluster):
    """Return the process ids of a cluster's workers."""
    with Client(cluster.scheduler_address, set_as_default=False) as client:
        return list(client.run(os.getpid).values())


def labelled(path, *, seed, many=5):
    """Write ``many`` random recordings of three classes to a file, and return its path."""
    r = np.random.default_rng(seed)
    np.savez(
        path,
        spikes=(r.random((many, CHANNELS, STEPS)) < 0.2).astype(np.uint8),
        labels=np.arange(many) % 3,
    )
    return path


def explore(*arguments):
    """Run ``locsnn explore``, and return its exit code."""
    return main(["explore", *map(str, arguments)])


def narrow(*strategies, bits=(8,)):
    """Return the options of a small grid: these strategies and weight bits, every other dial at its neutral value."""
    other_options = []
    for dial in OTHER_DIALS:
        other_options += [dial.option, dial.neutral]
    return ["--strategy", *strategies, "--weight-bits", *bits, *other_options]


def setting(strategy, bits):
    """Return a setting whose other values are neutral."""
    return Setting(strategy, bits, *(dial.neutral for dial in OTHER_DIALS))


def explored(folder):
    """Return the document explore.json of a folder."""
    return json.loads((folder / "explore.json").read_text())


def files_without_timings(folder):
    """Return the contents of the files that do not depend on where and when points were measured, by name.

    ``timings.csv`` is left out, as its times differ from run to run.
    """
    return {
        name: (folder / name).read_bytes()
        for name in ("explore.json", "explore.csv", "explore.svg")
    }


def figures(spikes=0.9, predictions=1.0, energy=1e6, time=1e6, scores=0.0):
    """Return figures of a point by hand: agreement of spikes and predictions, picojoules, nanoseconds, score error."""
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
    """Return a point of strategy ``name`` with the figures ``found``, or with the reason why it was refused."""
    if refusal:
        found = None
    elif found is None:
        found = figures()
    return Point(setting(name, bits), found, refusal, timings or {}, code="1+code")
