"""viewer.html: its data are what both sides did, and in a browser a person can walk through the differences.

The data are compared with the reference and the simulator, which play the same recordings again. Tests with a browser
open the page in Chromium, press keys, and read what it shows; they are skipped where there is no Chromium.
"""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.emitters import EMIT_KINDS
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.viewer import values as viewer
from locsnn_compile.report.viewer.page import render_viewer
from locsnn_compile.verification.observation import Observed
from tests.support.chromium import find_chromium, started
from tests.support.networks import hybrid, recordings

NETWORK = hybrid(scale=30.0, channels=8, steps=20, hidden=5)
PLAYED = recordings(NETWORK, samples=12, rate=0.6)
"""Two recordings more than a page has."""
LABELS = np.arange(12) % 2


@pytest.fixture(scope="module")
def compiled():
    """A network whose weights of 1 bit make the chip differ from the reference."""
    return lc.compile(
        NETWORK, weight_bits=1, strategy="dendrite", events=PLAYED, labels=LABELS, diagnosis=False
    )


def page_of(compiled, spikes=PLAYED, labels=LABELS):
    """Return the viewer's page of a compiled model on some recordings."""
    observed = Observed(compiled.levels, spikes, labels)
    return render_viewer(observed, compiled.figures, compiled.match.first_divergence)


@pytest.fixture(scope="module")
def page(compiled):
    return page_of(compiled).decode()


def values_of(page):
    """Return the data in a viewer's page, with recordings in the order of their numbers."""
    values = json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    )
    values["recordings"].sort(key=lambda row: row["number"])
    return values


def array(text, kind):
    """Return the numbers in a base64 text; ``kind`` is numpy's name of their type."""
    return np.frombuffer(base64.b64decode(text), dtype=f"<{kind}")


def test_spikes_are_those_of_both_sides(compiled, page):
    values = values_of(page)
    assert [recording["number"] for recording in values["recordings"]] == list(range(10))
    for recording in values["recordings"]:
        spikes = PLAYED[[recording["number"]]]
        reference = evaluate(NETWORK, spikes)
        chip = hw.simulate(compiled.program, spikes)
        assert recording["label"] == LABELS[recording["number"]]
        for population in values["populations"]:
            name = population["name"]
            reference_text, chip_text = recording["spikes"][name]
            # Numbers are step * size + neuron, as numpy counts in arrays (steps, neurons).
            assert np.array_equal(
                array(reference_text, "u4"), np.flatnonzero(reference.spikes[name][0])
            )
            assert np.array_equal(array(chip_text, "u4"), np.flatnonzero(chip.spikes[name][0]))


def test_potentials_are_those_of_both_sides(compiled, page):
    number = 3
    values = values_of(page)
    recording = values["recordings"][number]
    reference = evaluate(NETWORK, PLAYED[[number]], potentials=True).potential
    chip = hw.simulate(compiled.program, PLAYED[[number]], probe=("potential",)).potential
    for population in values["populations"]:
        name = population["name"]
        stored = recording["potentials"][name]
        grades = array(stored["values"], "u2").reshape(2, -1, population["steps"])
        reference_shown, chip_shown = stored["low"] + stored["grade"] * grades
        assert population["kept"] == list(range(population["size"]))
        scale = compiled.levels.quantized.population(name).scale
        assert np.abs(reference_shown - reference[name][0].T).max() <= stored["grade"]
        assert np.abs(chip_shown - (chip[name][0] / scale).T).max() <= stored["grade"]


def test_activity_adds_up_to_the_counts(compiled, page):
    recording = values_of(page)["recordings"][0]
    counts = hw.simulate(compiled.program, PLAYED[[0]]).counts_by_phase
    for phase, texts in recording["activity"].items():
        operations, spikes, _ = (int(array(text, "u4").sum()) for text in texts)
        assert (operations, spikes) == (counts[phase].synaptic_ops, counts[phase].spikes)


def test_a_page_with_less_room_keeps_the_first_difference(compiled, monkeypatch):
    usual_length = len(page_of(compiled))
    # Room for some of the recordings and some potentials.
    monkeypatch.setattr(viewer, "MOST_TEXT", 14_000)
    values = values_of(page_of(compiled).decode())
    assert len(page_of(compiled)) < usual_length
    first = compiled.match.first_divergence
    assert first is not None
    assert first.recording in {recording["number"] for recording in values["recordings"]}
    populations = {population["name"]: population for population in values["populations"]}
    assert first.neuron in populations[first.population]["kept"]
    assert any(len(population["kept"]) < population["size"] for population in populations.values())


def test_equal_input_gives_equal_bytes(compiled, page):
    assert page_of(compiled).decode() == page


def test_it_is_small_and_loads_nothing(page):
    assert len(page) < 2_000_000
    assert "default-src 'none'" in page
    assert not re.findall(r"""(?:src|href)=["'](?!#)""", page)
    assert "The MIT License" in page
    assert "uPlot (v1.6.32)" in page


def test_names_are_text(compiled):
    model = replace(compiled.figures.model, name="</script><script>@@data@@<b>")
    figures = replace(compiled.figures, model=model)
    page = render_viewer(Observed(compiled.levels, PLAYED), figures, first=None).decode()
    assert "</script><script>@@" not in page
    assert page.count("<script") == page_of(compiled).decode().count("<script")
    assert values_of(page)["recordings"][0]["label"] is None


def test_the_report_has_no_script(compiled):
    assert "<script" not in compiled.to_html()


def test_it_is_emitted():
    assert "viewer" in EMIT_KINDS


@pytest.fixture(scope="module")
def chromium():
    """A browser; tests that need it are skipped where there is none."""
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium")
    with started(path) as browser:
        yield browser


@pytest.fixture
def opened(chromium, page, tmp_path):
    """A function that opens the page in the browser and returns the browser."""
    (tmp_path / "viewer.html").write_text(page, "utf-8")

    def show(**options):
        chromium.open(tmp_path / "viewer.html", **options)
        return chromium

    return show


def text(browser, name):
    """Return the text that the page shows in the element with this id."""
    return browser.evaluate(f"document.getElementById({name!r}).textContent")


def value(browser, name):
    """Return the value of the input element with this id."""
    return browser.evaluate(f"document.getElementById({name!r}).value")


def set_value(browser, name, number):
    """Set the input element with this id, as a person does."""
    browser.evaluate(f"document.getElementById({name!r}).value = {number}")
    browser.evaluate(f"document.getElementById({name!r}).dispatchEvent(new Event('input'))")


def recording_shown(browser):
    """Return the recording that is chosen, as ``number, label``."""
    return browser.evaluate("document.getElementById('recording').selectedOptions[0].textContent")


KEY_PRESS = "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: KEY, bubbles: true}))"


RASTER_PICTURE = "document.querySelector('#raster canvas').toDataURL()"
"""The raster as a PNG in base64: its axes are drawn, so no element tells which steps are in sight."""


def press(browser, key):
    """Press a key on the page."""
    browser.evaluate(KEY_PRESS.replace("KEY", repr(key)))


def test_it_opens_at_the_first_difference(opened, compiled):
    browser = opened()
    first = compiled.match.first_divergence
    spike = f"{first.population}, neuron {first.neuron}, step {first.step}: only the "
    assert text(browser, "status").startswith(spike)
    assert recording_shown(browser) == f"{first.recording}, label {LABELS[first.recording]}"


def test_potentials_are_shown_as_exactly_as_they_are_stored(opened, compiled, page):
    """Further digits are not stored; they could show a potential on the wrong side of its threshold."""
    first = compiled.match.first_divergence
    recording = next(
        recording
        for recording in values_of(page)["recordings"]
        if recording["number"] == first.recording
    )
    grade = recording["potentials"][first.population]["grade"]
    last_digit = 10.0 ** -np.floor(-np.log10(grade))
    texts = re.findall(r"(?:network|chip) (-?[\d.]+)[,;]", text(opened(), "status"))
    exact_potentials = (first.reference_potential, first.chip_potential)
    for shown, exact in zip(texts, exact_potentials, strict=True):
        assert abs(float(shown) - exact) <= grade / 2 + last_digit / 2
        decimals = shown.partition(".")[2]
        assert len(decimals) <= -np.log10(last_digit)


def test_a_person_walks_through_the_differences(opened, compiled):
    browser = opened()
    first_status = text(browser, "status")
    press(browser, "n")
    next_status = text(browser, "status")
    assert next_status != first_status
    assert "only the " in next_status
    press(browser, "p")
    assert text(browser, "status") == first_status
    press(browser, "]")
    press(browser, "f")
    number = int(recording_shown(browser).split(",")[0])
    reference = evaluate(NETWORK, PLAYED).spikes
    chip = hw.simulate(compiled.program, PLAYED).spikes
    differences = sum(
        int((reference[population.name][number] != chip[population.name][number]).sum())
        for population in NETWORK.populations
    )
    summary = text(browser, "summary").replace("One spike is", "1 spikes are")
    assert f" {differences} spikes are on one side only." in summary


def test_keys_move_the_step_and_the_neuron(opened):
    browser = opened()
    set_value(browser, "step", 3)
    press(browser, "ArrowRight")
    assert (value(browser, "step"), text(browser, "step-shown")) == ("4", "4 of 19")
    press(browser, "ArrowLeft")
    assert value(browser, "step") == "3"
    press(browser, "0")
    neuron = int(value(browser, "neuron"))
    press(browser, "j" if neuron == 0 else "k")
    assert abs(int(value(browser, "neuron")) - neuron) == 1
    # More often than there are neurons: the last one stays.
    for _ in range(9):
        press(browser, "j")
    last = int(browser.evaluate("document.getElementById('neuron').max"))
    assert int(value(browser, "neuron")) == last


def test_a_zoomed_raster_stays_as_it_is_while_the_neuron_changes_and_changes_back(opened):
    browser = opened()
    set_value(browser, "population", 0)
    set_value(browser, "neuron", 0)
    press(browser, "+")
    raster = browser.evaluate(RASTER_PICTURE)
    press(browser, "j")
    assert browser.evaluate(RASTER_PICTURE) != raster
    press(browser, "k")
    assert browser.evaluate(RASTER_PICTURE) == raster


def test_it_shows_the_mesh_at_a_step_and_plays_on(opened, compiled):
    step = 7
    browser = opened()
    set_value(browser, "population", 0)
    set_value(browser, "step", step)
    number = int(recording_shown(browser).split(",")[0])
    result = hw.simulate(compiled.program, PLAYED[[number]], probe=("activity",))
    operations = result.activity["time"][0].count("synaptic_ops")
    shown = browser.evaluate("document.querySelector('.core.here b').textContent")
    assert int(shown.replace(",", "")) == operations[step].max()
    press(browser, " ")
    assert text(browser, "play") == "Pause"
    press(browser, " ")
    assert text(browser, "play") == "Play"


def test_an_input_has_no_potential(opened):
    browser = opened()
    # The inputs follow the populations, of which there are four.
    set_value(browser, "population", 4)
    assert text(browser, "not-kept") == "An input line has no potential."


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
def test_the_page_fits_every_screen(opened, width, dark):
    """No error, no request, nothing wider than the screen, and something drawn in both plots."""
    browser = opened(width=width, dark=dark)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    has_pixels = "[...document.querySelectorAll('canvas')].map(c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(v => v))"
    assert browser.evaluate(has_pixels) == [True, True]
    methods = [event["method"] for event in browser.events]
    assert "Runtime.exceptionThrown" not in methods
    assert "Log.entryAdded" not in methods
    requests = [
        event["params"]["request"]["url"]
        for event in browser.events
        if event["method"] == "Network.requestWillBeSent"
    ]
    assert all(url.startswith("file:") for url in requests)
    assert len(requests) <= 1


def test_without_a_difference_there_is_nowhere_to_go(chromium, tmp_path):
    network = replace(NETWORK, recordings=None)
    spikes = np.zeros((1, 20, 8), dtype=np.uint8)
    silent = lc.compile(network, events=spikes, strategy="dendrite", diagnosis=False)
    (tmp_path / "silent.html").write_bytes(page_of(silent, spikes, labels=None))
    chromium.open(tmp_path / "silent.html")
    assert text(chromium, "summary").endswith(
        "the network predicts no class, the chip no class. Every spike is equal."
    )
    assert chromium.evaluate("document.getElementById('next').disabled") is True
