"""``ModelFile``: a model and its options as the command line names them, loaded, printed again, and hashed."""

import inspect
from dataclasses import fields, replace

import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main, parser
from locsnn_compile.errors import InputError
from locsnn_compile.explore.point import ModelFile
from locsnn_compile.frontends.format_rows import LoadOptions


def test_a_checkpoint_needs_nothing_else(model):
    file = ModelFile(str(model))
    assert file.load().sha256 == lc.load(model).sha256
    assert file.arguments() == [str(model)]


def test_options_are_passed_on_and_said_again(model):
    options = LoadOptions(
        config="a.yaml", dt=0.001, reset="zero", discretisation="exact", kernels="cut"
    )
    file = ModelFile(str(model), options)
    arguments = [
        "--config",
        "a.yaml",
        "--dt",
        "0.001",
        "--reset",
        "zero",
        "--discretisation",
        "exact",
        "--kernels",
        "cut",
    ]
    assert file.arguments() == [str(model), *arguments]
    with pytest.raises(InputError) as caught:
        replace(file, options=replace(options, config=None)).load()
    assert str(caught.value) == (
        f"model '{model.name}': dt was given, but a checkpoint contains this itself. Leave dt out."
    )


def test_it_has_every_argument_of_load_and_the_command_every_option():
    names = [field.name for field in fields(LoadOptions)]
    assert {"model", *names} == set(inspect.signature(lc.load).parameters)
    values = dict.fromkeys(names, "1") | {"channel_order": "pyx", "relay_delays": True}
    typed = ModelFile("m.pt", LoadOptions(**values)).arguments()
    read = parser().parse_args(["explore", *typed])
    assert vars(LoadOptions.of(read)) == values | {"dt": 1.0, "floor": 1.0}


def test_the_command_passes_kernels_on(model, tmp_path, capsys):
    assert main(["explore", str(model), "--kernels", "cut", "-o", str(tmp_path / "out")]) == 2
    line = f"model {str(model)!r}: kernels was given, but a checkpoint contains this itself. Leave kernels out.\n"
    assert capsys.readouterr().err == line


def test_the_digest_follows_files_and_options(tmp_path):
    for name, text in (
        ("a.pt", "one"),
        ("b.pt", "two"),
        ("same.pt", "one"),
        ("x.yaml", "config"),
        ("y.yaml", "other"),
    ):
        (tmp_path / name).write_text(text)

    def digest(name, config=None, **options):
        described = config and str(tmp_path / config)
        return ModelFile(str(tmp_path / name), LoadOptions(described, **options)).digest()

    assert digest("a.pt") == digest("same.pt")
    different = [
        digest("a.pt"),
        digest("b.pt"),
        digest("a.pt", "x.yaml"),
        digest("a.pt", "y.yaml"),
        digest("a.pt", dt=0.1),
        digest("a.pt", reset="zero"),
        digest("a.pt", kernels="cut"),
    ]
    assert len(set(different)) == len(different)
