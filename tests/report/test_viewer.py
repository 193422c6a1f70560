"""viewer.html: what it holds is what both sides did, and in a browser a person can walk through it; it loads nothing."""

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
LABELS = np.arange(12) % 2


@pytest.fixture(scope="module")
def compiled():
    """A network whose weights of 1 bit make the chip differ from the reference."""
    return lc.compile(
        NETWORK, weight_bits=1, strategy="dendrite", events=PLAYED, labels=LABELS, diagnosis=False
    )


def page_of(compiled, spikes=PLAYED, labels=LABELS):
    """The viewer of what was compiled, as HTML, for some recordings."""
    observed = Observed(compiled.levels, spikes, labels)
    return render_viewer(observed, compiled.figures, compiled.match.first_divergence)


@pytest.fixture(scope="module")
def page(compiled):
    return page_of(compiled).decode()


def values_of(page):
    """The values in a viewer's page, with recordings in the order of their numbers."""
    values = json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    )
    values["recordings"].sort(key=lambda row: row["number"])
    return values


def array(text, kind):
    return np.frombuffer(base64.b64decode(text), dtype=f"<{kind}")


def test_spikes_are_those_of_both_sides(compiled, page):
    values = values_of(page)
    assert [row["number"] for row in values["recordings"]] == list(range(10))
    for row in values["recordings"]:
        one = PLAYED[[row["number"]]]
        reference, chip = evaluate(NETWORK, one), hw.simulate(compiled.program, one)
        assert row["label"] == LABELS[row["number"]]
        for population in values["populations"]:
            name = population["name"]
            for text, side in zip(
                row["spikes"][name], (reference.spikes[name], chip.spikes[name]), strict=True
            ):
                assert np.array_equal(array(text, "u4"), np.flatnonzero(side[0]))


def test_potentials_are_those_of_both_sides(compiled, page):
    values = values_of(page)
    row = values["recordings"][3]
    reference = evaluate(NETWORK, PLAYED[[3]], potentials=True).potential
    chip = hw.simulate(compiled.program, PLAYED[[3]], probe=("potential",)).potential
    for population in values["populations"]:
        name, held = population["name"], row["potentials"][population["name"]]
        found = held["low"] + held["grade"] * array(held["values"], "u2").reshape(
            2, -1, population["steps"]
        )
        assert population["kept"] == list(range(population["size"]))
        scale = compiled.levels.quantized.population(name).scale
        for side, wanted in zip(found, (reference[name][0], chip[name][0] / scale), strict=True):
            assert np.abs(side - wanted.T).max() <= held["grade"]


def test_activity_adds_up_to_the_counts(compiled, page):
    row = values_of(page)["recordings"][0]
    counts = hw.simulate(compiled.program, PLAYED[[0]]).counts_by_phase
    for phase, texts in row["activity"].items():
        operations, spikes, _ = (int(array(text, "u4").sum()) for text in texts)
        assert (operations, spikes) == (counts[phase].synaptic_ops, counts[phase].spikes)


def test_what_there_is_no_room_for_is_left_out(compiled, monkeypatch):
    usual = len(page_of(compiled))
    monkeypatch.setattr(viewer, "MOST_TEXT", 14_000)
    values = values_of(page_of(compiled).decode())
    assert len(page_of(compiled)) < usual
    first = compiled.match.first_divergence
    assert first is not None
    assert first.recording in {row["number"] for row in values["recordings"]}
    (kept,) = (one["kept"] for one in values["populations"] if one["name"] == first.population)
    assert first.neuron in kept
    assert sum(len(one["kept"]) < one["size"] for one in values["populations"]) > 0


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
    page = render_viewer(Observed(compiled.levels, PLAYED), figures, None).decode()
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
    """Return what opens the page in the browser."""
    (tmp_path / "viewer.html").write_text(page, "utf-8")

    def show(**options):
        chromium.open(tmp_path / "viewer.html", **options)
        return chromium

    return show


def text(browser, name):
    """The text that the page shows in an element."""
    return browser.evaluate(f"document.getElementById({name!r}).textContent")


def value(browser, name):
    """The value of an input element of the page."""
    return browser.evaluate(f"document.getElementById({name!r}).value")


LISTEN = "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: KEY, bubbles: true}))"


def press(browser, letter):
    """Press a key on the page."""
    browser.evaluate(LISTEN.replace("KEY", repr(letter)))


def test_it_opens_at_the_first_difference(opened, compiled):
    browser, first = opened(), compiled.match.first_divergence
    where = f"{first.population}, neuron {first.neuron}, step {first.step}: only the "
    assert text(browser, "status").startswith(where)
    number = browser.evaluate("document.getElementById('recording').selectedOptions[0].textContent")
    assert number == f"{first.recording}, label {LABELS[first.recording]}"


def test_potentials_are_shown_as_exactly_as_they_are_held(opened, compiled, page):
    """A digit more would put a potential on the wrong side of its threshold."""
    first, values = compiled.match.first_divergence, values_of(page)
    row = next(one for one in values["recordings"] if one["number"] == first.recording)
    grade = row["potentials"][first.population]["grade"]
    shown = re.findall(r"(?:network|chip) (-?[\d.]+)[,;]", text(opened(), "status"))
    wanted = (first.reference_potential, first.chip_potential)
    unit = 10.0 ** -np.floor(-np.log10(grade))
    assert [
        abs(float(one) - exact) <= grade / 2 + unit / 2
        for one, exact in zip(shown, wanted, strict=True)
    ] == [True] * 2
    assert all(len(one.partition(".")[2]) <= -np.log10(unit) for one in shown)


def test_a_person_walks_through_the_differences(opened, compiled):
    browser = opened()
    begin = text(browser, "status")
    press(browser, "n")
    after = text(browser, "status")
    assert after != begin
    assert "only the " in after
    press(browser, "p")
    assert text(browser, "status") == begin
    press(browser, "]")
    press(browser, "f")
    reference, chip = (
        side.spikes for side in (evaluate(NETWORK, PLAYED), hw.simulate(compiled.program, PLAYED))
    )
    shown = int(
        browser.evaluate(
            "document.getElementById('recording').selectedOptions[0].textContent"
        ).split(",")[0]
    )
    differs = sum(
        int((reference[p.name][shown] != chip[p.name][shown]).sum()) for p in NETWORK.populations
    )
    assert f" {differs} spikes are on one side only." in text(browser, "summary").replace(
        "One spike is", "1 spikes are"
    )


def test_keys_move_the_step_and_the_neuron(opened):
    browser = opened()
    browser.evaluate("document.getElementById('step').value = 3")
    browser.evaluate("document.getElementById('step').dispatchEvent(new Event('input'))")
    press(browser, "ArrowRight")
    assert (value(browser, "step"), text(browser, "step-shown")) == ("4", "4 of 19")
    press(browser, "ArrowLeft")
    assert value(browser, "step") == "3"
    press(browser, "0")
    before = int(value(browser, "neuron"))
    press(browser, "j" if before == 0 else "k")
    assert abs(int(value(browser, "neuron")) - before) == 1
    for _ in range(9):
        press(browser, "j")
    last = int(browser.evaluate("document.getElementById('neuron').max"))
    assert int(value(browser, "neuron")) == last


def test_it_plays_the_mesh(opened, compiled):
    browser = opened()
    browser.evaluate("document.getElementById('population').value = 0")
    browser.evaluate("document.getElementById('population').dispatchEvent(new Event('input'))")
    browser.evaluate("document.getElementById('step').value = 7")
    browser.evaluate("document.getElementById('step').dispatchEvent(new Event('input'))")
    number = int(
        browser.evaluate(
            "document.getElementById('recording').selectedOptions[0].textContent"
        ).split(",")[0]
    )
    activity = hw.simulate(compiled.program, PLAYED[[number]], probe=("activity",)).activity[
        "time"
    ][0]
    shown = browser.evaluate("document.querySelector('.core.here b').textContent")
    assert int(shown.replace(",", "")) == activity.count("synaptic_ops")[7].max()
    press(browser, " ")
    assert text(browser, "play") == "Pause"
    press(browser, " ")
    assert text(browser, "play") == "Play"


def test_an_input_has_no_potential(opened):
    browser = opened()
    browser.evaluate("document.getElementById('population').value = 4")
    browser.evaluate("document.getElementById('population').dispatchEvent(new Event('input'))")
    assert text(browser, "not-kept") == "An input line has no potential."


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
def test_every_screen(opened, width, dark):
    """No error, no request, nothing wider than the screen, and something drawn in both plots."""
    browser = opened(width=width, dark=dark)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    drawn = "[...document.querySelectorAll('canvas')].map(c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(v => v))"
    assert browser.evaluate(drawn) == [True, True]
    told = [event["method"] for event in browser.events]
    assert "Runtime.exceptionThrown" not in told
    assert not [event for event in browser.events if event["method"] == "Log.entryAdded"]
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
    (tmp_path / "silent.html").write_bytes(page_of(silent, spikes, None))
    chromium.open(tmp_path / "silent.html")
    assert text(chromium, "summary").endswith(
        "the network predicts no class, the chip no class. Every spike is equal."
    )
    assert chromium.evaluate("document.getElementById('next').disabled") is True
