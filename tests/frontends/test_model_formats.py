"""The table of model formats: a new row is all that a new format needs, and every file finds its row."""

import json
from dataclasses import replace

import pytest

import locsnn_compile as lc
from locsnn_compile.cli.options import add_options
from locsnn_compile.cli.shell import Parser
from locsnn_compile.errors import InputError
from locsnn_compile.frontends import formats
from locsnn_compile.frontends.format_rows import LoadOptions, ModelFormat, ModelSource
from locsnn_compile.frontends.formats import (
    FORMAT_OPTIONS,
    MODEL_FORMATS,
    format_of,
    models_in_words,
)


def read_plain(source):
    """Read a network of one neuron whose threshold is in a JSON file."""
    threshold = json.loads(source.path.read_text())["threshold"]
    neuron = lc.Cuba.of(1, decay_v=0.5, threshold=threshold)
    return lc.Network(
        source.path.stem,
        1,
        4,
        views=(lc.InputView("touch", "time", 1),),
        populations=(lc.Population("cell", "time", 1, neuron),),
        projections=(lc.Projection("touch", "cell", [[1.0]]),),
        readout=lc.Readout(("cell",), (1.0,)),
    )


PLAIN = ModelFormat(
    called="a plain network",
    helped="plain network (.plain)",
    offered="a plain network (.plain)",
    suffixes=(".plain",),
    recognises=lambda source: True,
    read=read_plain,
)


@pytest.fixture
def with_plain(monkeypatch):
    """Add a format to the table, before the last row, with whose words the list in ``--help`` ends."""
    *others, last = MODEL_FORMATS
    monkeypatch.setattr(formats, "MODEL_FORMATS", (*others, PLAIN, last))


def test_a_row_adds_a_format(with_plain, tmp_path):
    path = tmp_path / "m.plain"
    path.write_text('{"threshold": 2.0}')
    assert lc.load(path).populations[0].neuron.threshold.tolist() == [2.0]


def test_help_and_errors_name_a_format_that_a_row_adds(with_plain, tmp_path):
    assert models_in_words() == (
        "checkpoint (.pt) of `locsnn train`, NIR graph (.nir), lava-dl network (.net), "
        "plain network (.plain) or, with --config, a state dict of torch or slayerPytorch"
    )
    with pytest.raises(InputError) as caught:
        lc.load(tmp_path / "m.onnx")
    assert str(caught.value) == (
        "model 'm.onnx': files ending in '.onnx' are not read. Give a checkpoint (.pt) that "
        "`locsnn train` wrote, a NIR graph (.nir), a lava-dl network (.net), "
        "or a plain network (.plain)."
    )


def test_a_format_refuses_options_of_others(with_plain, tmp_path):
    (tmp_path / "m.plain").write_text('{"threshold": 2.0}')
    with pytest.raises(InputError) as caught:
        lc.load(tmp_path / "m.plain", dt=0.0)
    assert str(caught.value) == (
        "model 'm.plain': dt was given, but a plain network contains this itself. Leave dt out."
    )


@pytest.mark.parametrize(
    ("name", "config", "called"),
    [
        ("m.pt", None, "a checkpoint"),
        ("m.pth", None, "a checkpoint"),
        ("m.pt", "net.yaml", "a slayerPytorch checkpoint"),
    ],
)
def test_checkpoints_are_recognised_by_whether_they_have_a_description(
    tmp_path, name, config, called
):
    source = ModelSource(tmp_path / name, LoadOptions(config=config))
    assert format_of(source).called == called


def test_every_option_of_a_format_is_declared_and_on_the_command_lines():
    names = {option.name for option in FORMAT_OPTIONS}
    assert names == {name for row in MODEL_FORMATS for name in row.options}
    for command in ("compile", "explore"):
        parser = Parser("locsnn")
        add_options(parser, command)
        models = ["m.pt"] if command == "explore" else [["m.pt"]]
        read = parser.parse_args(["m.pt"])
        assert read.model in models
        assert LoadOptions.of(read) == LoadOptions()


def test_options_that_are_off_count_as_not_given():
    assert LoadOptions(dt=0.0, relay_delays=False).given == {"dt": 0.0}
    assert replace(LoadOptions(), relay_delays=True).given == {"relay_delays": True}
