"use strict";
/*
 * The script of viewer.html, a page on which a person compares the spikes of a network with those of the program that
 * was compiled from it for a chip. Both played the same recordings. The two *sides* of the comparison are "reference",
 * the network as it was before compiling, and "chip", the simulated chip. The page shows, from top to bottom:
 *
 * - one recording in words, and how many of its spikes are on one side only: the differences
 * - the raster: all spikes of one population, neurons over steps
 * - the potential of one of its neurons over the same steps, on both sides
 * - the mesh: what each core of the chip counted in one step
 * - a table of the differences of each population
 *
 * `state` holds what is chosen. Controls, keys and clicks change it through `choose`, which draws the page again.
 *
 * The page carries its data as JSON, which locsnn_compile/report/viewer/values.py writes:
 *
 *   recordings   a list of
 *     number         its place among the recordings that were checked
 *     label          its class, or null
 *     predictions    [reference, chip]; -1 where all class scores tie
 *     spikes         by population and input: [reference, chip], each an array of `step * size + neuron`, ascending
 *     activity       by phase: for each of `quantities` an array of counts, (steps, cores of the phase in the order
 *                    of `cores`)
 *     potentials     by population: {low, grade, values}; `low + grade * values` is (2 sides, kept neurons, steps), in
 *                    the units of the network
 *   samples      how many recordings were checked; the page has some of them
 *   populations  a list of {name, axis: its phase, size: neurons, steps, kept: the neurons whose potentials are on the
 *                page, thresholds: of those neurons, cores: the numbers of its cores}
 *   inputs       a list of {name, axis, size: lines, steps}
 *   phases       names of the parts of a recording on the chip, in the order in which they run; each has its own steps
 *   first        the first spike that differs, {recording, population, neuron, step, ...}, or null
 *   quantities   names of what is counted of a core in a step
 *   cores        a list of {core: its number, phase, tile: [column, row] in the mesh, ...}
 *
 * Arrays are base64 of little-endian numbers without sign: 32 bits, but 16 bits for potentials.
 */
(() => {
  const element = (id) => document.getElementById(id);

  /* ---- constants ------------------------------------------------------------------------------------------------ */

  /* Spikes are of three kinds, and everything that is listed by kind is in this order. The names are also those of the
   * colours in viewer.css. */
  const SPIKE_KINDS = ["both", "reference", "chip"];
  const SPIKE_TEXTS = ["spikes on both sides", "only the network spikes", "only the chip spikes"];
  /* A spike of both sides is a whole stroke, of the network alone its upper half, of the chip alone its lower half. The
   * numbers are fractions of the height of a whole stroke, from its top. */
  const STROKES = [
    { top: 0, height: 1 },
    { top: 0, height: 0.5 },
    { top: 0.5, height: 0.5 },
  ];
  const QUANTITY_TEXTS = {
    synaptic_ops: "synaptic operations",
    spikes: "spikes",
    packets_received: "packets received",
  };

  /* Numbers of steps. */
  const STEPS_AROUND_DIFFERENCE = 30; // shown to each side of a difference that is jumped to
  const MIN_ZOOM_SPAN = 4; // from the first step in sight to the last
  const STEPS_OF_SHIFT_ARROW = 10;
  /* Ticks stand at whole steps and neurons only. */
  const TICK_INTERVALS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];

  /* CSS pixels. */
  const PLOT_HEIGHTS = { raster: 320, potential: 240 };
  const MIN_PLOT_WIDTH = 200;
  const MIN_SELECTION_WIDTH = 4; // a narrower drag does not zoom
  const MAX_CLICK_DISTANCE = 3; // from where the button was pressed; farther is a drag
  const POTENTIAL_STROKE_WIDTH = 2;
  const POTENTIAL_STROKE_HEIGHT = 12;

  /* The core with the largest count has share 1; above this share its background is so dark that its text is light. */
  const LIGHT_TEXT_SHARE = 0.6;
  const MAX_DECIMALS = 20; // what `toFixed` takes in every browser

  /* ---- data and state ------------------------------------------------------------------------------------------- */

  const data = JSON.parse(element("data").textContent);
  // The recording of the first difference comes first in the data, so that it is never left out for want of room.
  data.recordings.sort((a, b) => a.number - b.number);
  const { populations, recordings } = data;
  /* A group is a population or an input. Populations come first, so that they have the same index in both lists. */
  const groups = [...populations, ...data.inputs.map((input) => ({ ...input, isInput: true, cores: [] }))];

  /* `recording`, `population` (which may be an input) and `quantity` are indices into `recordings`, `groups` and
   * `data.quantities`. `range` is what the plots show of the steps, [from, to]; `zoom` puts its ends half a step
   * outside the first and the last step in sight. */
  const state = { recording: 0, population: 0, neuron: 0, step: 0, range: [0, 1], quantity: 0 };

  const chosenRecording = () => recordings[state.recording];
  const chosenGroup = () => groups[state.population];
  const lastStep = () => chosenGroup().steps - 1;
  const indexOfGroup = (name) => groups.findIndex((group) => group.name === name);
  const isInRange = (step) => step >= state.range[0] && step <= state.range[1];
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  function decodeArray(base64, ArrayType) {
    const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
    return new ArrayType(bytes.buffer);
  }

  /* ---- spikes, differences and potentials of the chosen recording ----------------------------------------------- */

  /** Split two ascending lists into [numbers in both, in the first alone, in the second alone]. */
  function splitByMembership(first, second) {
    const both = [];
    const firstOnly = [];
    const secondOnly = [];
    let i = 0;
    let j = 0;
    while (i < first.length || j < second.length) {
      if (j >= second.length || first[i] < second[j]) {
        firstOnly.push(first[i++]);
      } else if (i >= first.length || second[j] < first[i]) {
        secondOnly.push(second[j++]);
      } else {
        both.push(first[i++]);
        j++;
      }
    }
    return [both, firstOnly, secondOnly];
  }

  /** Turn spike numbers `step * size + neuron` into an array of steps and one of neurons. */
  function splitSpikeNumbers(spikeNumbers, size) {
    const steps = new Uint32Array(spikeNumbers.length);
    const neurons = new Uint32Array(spikeNumbers.length);
    for (let i = 0; i < spikeNumbers.length; i++) {
      steps[i] = Math.floor(spikeNumbers[i] / size);
      neurons[i] = spikeNumbers[i] % size;
    }
    return { steps, neurons };
  }

  // Spikes and differences are computed once per recording, as every draw needs them.
  const spikesCache = new Map();
  const differencesCache = new Map();

  /** Return the spikes of a group in the chosen recording, {steps, neurons} of each kind, by ascending step. */
  function spikesByKind(group) {
    const key = `${state.recording}/${group.name}`;
    if (!spikesCache.has(key)) {
      const [reference, chip] = chosenRecording().spikes[group.name].map((base64) => decodeArray(base64, Uint32Array));
      const numbersByKind = splitByMembership(reference, chip);
      spikesCache.set(key, numbersByKind.map((spikeNumbers) => splitSpikeNumbers(spikeNumbers, group.size)));
    }
    return spikesCache.get(key);
  }

  /** Return the kind of spike, an index into SPIKE_KINDS, of a neuron of a group at a step; -1 if it has none. */
  function spikeKindAt(group, neuron, step) {
    return spikesByKind(group).findIndex(({ steps, neurons }) => {
      for (let i = 0; i < steps.length && steps[i] <= step; i++) {
        if (steps[i] === step && neurons[i] === neuron) return true;
      }
      return false;
    });
  }

  /**
   * Return all differences of the chosen recording, each {phase, step, population, neuron}, in the order in which they
   * arise: phase after phase, step after step, and within a step in the order of the populations in the network.
   */
  function differences() {
    if (!differencesCache.has(state.recording)) {
      const differing = [];
      populations.forEach((group, population) => {
        const phase = data.phases.indexOf(group.axis);
        const [, referenceOnly, chipOnly] = spikesByKind(group);
        for (const { steps, neurons } of [referenceOnly, chipOnly]) {
          steps.forEach((step, i) => differing.push({ phase, step, population, neuron: neurons[i] }));
        }
      });
      differencesCache.set(state.recording, differing.sort(compareInTime));
    }
    return differencesCache.get(state.recording);
  }

  function compareInTime(a, b) {
    return a.phase - b.phase || a.step - b.step || a.population - b.population || a.neuron - b.neuron;
  }

  /** Return the chosen neuron and step as if it were a difference, to find the next and the previous one. */
  function chosenPlace() {
    const group = chosenGroup();
    return {
      phase: data.phases.indexOf(group.axis),
      step: state.step,
      population: populations.indexOf(group), // -1 for an input: before all populations of the same step
      neuron: state.neuron,
    };
  }

  /**
   * Return the potentials of the chosen neuron, {reference, chip, threshold, grade} with an array over steps for each
   * side, in units of the network; null if the page has none of this neuron.
   */
  function chosenPotentials() {
    const group = chosenGroup();
    if (group.isInput) return null;
    const row = group.kept.indexOf(state.neuron);
    if (row < 0) return null;
    const { low, grade, values } = chosenRecording().potentials[group.name];
    const grades = decodeArray(values, Uint16Array);
    const potentialsOf = (side) => {
      const start = (side * group.kept.length + row) * group.steps;
      return Array.from(grades.subarray(start, start + group.steps), (value) => low + grade * value);
    };
    return { reference: potentialsOf(0), chip: potentialsOf(1), threshold: group.thresholds[row], grade };
  }

  /* ---- plots: raster and potential ------------------------------------------------------------------------------ */

  // uPlot draws axes, lines and cursor; its hook `draw` adds the spikes and the chosen step on the same canvas. Canvas
  // pixels are CSS pixels times `devicePixelRatio`; `valToPos(..., true)` returns them, `posToVal` takes CSS pixels.

  const plots = {};

  /** Return a colour of viewer.css. It is read at each draw, as it changes between light and dark. */
  function cssColour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  function createPlots() {
    plots.raster = createPlot({
      id: "raster",
      // A series without values: it gives the plot its axes, and the hook draws the spikes.
      series: [{}, { label: "neuron", paths: () => null, points: { show: false } }],
      yScale: { dir: -1, range: allNeurons }, // neuron 0 at the top
      yAxis: { label: "neuron", incrs: TICK_INTERVALS },
      draw: drawRaster,
    });
    plots.potential = createPlot({
      id: "potential",
      series: [
        {},
        lineSeries("reference", "reference"),
        lineSeries("chip", "chip", [6, 4]),
        lineSeries("threshold", "soft", [2, 4]),
      ],
      yScale: { range: withMargins },
      yAxis: { label: "potential" },
      draw: drawPotential,
    });
  }

  // uPlot asks for the ends of the vertical scales whenever the steps in sight change.

  /** Return the vertical ends of the raster; uPlot cannot know them, as its series has no values. */
  function allNeurons() {
    return [-0.5, chosenGroup().size - 0.5];
  }

  /** Return the vertical ends of the potential, given its least and largest value in sight, threshold included. */
  function withMargins(plot, low, high) {
    if (low === null) return [0, 1]; // before the plot has data
    const margin = (high - low) * 0.08 || 1; // 1 where the potential never moves
    // Twice the margin at the top, where the strokes of the spikes are.
    return [low - margin, high + 2 * margin];
  }

  /** Return a line of a plot; `dash` is the lengths of dashes and gaps in pixels. */
  function lineSeries(label, colourName, dash) {
    return { label, stroke: () => cssColour(colourName), width: 1.5, dash, points: { show: false } };
  }

  function createPlot({ id, series, yScale, yAxis, draw }) {
    const box = element(id);
    const options = {
      width: Math.max(box.clientWidth, MIN_PLOT_WIDTH),
      height: PLOT_HEIGHTS[id],
      padding: [8, 8, 0, 0],
      cursor: {
        sync: { key: "steps", setSeries: false }, // the cursor stands at the same step in both plots
        drag: { x: true, y: false, setScale: true },
        points: { show: false },
      },
      legend: { show: false },
      scales: { x: { time: false, range: () => state.range }, y: yScale },
      axes: [
        { ...axisStyle(), label: "step", size: 34, space: 60, incrs: TICK_INTERVALS },
        { ...axisStyle(), size: 52, ...yAxis },
      ],
      series,
      hooks: { draw: [draw], setSelect: [zoomToSelection] },
    };
    const emptyData = [[0, 1], ...series.slice(1).map(() => [null, null])];
    const plot = new uPlot(options, emptyData, box);
    chooseByClick(plot, id);
    plot.over.addEventListener("dblclick", zoomToAllSteps);
    return plot;
  }

  function axisStyle() {
    const font = "12px system-ui, sans-serif";
    const rule = { stroke: () => cssColour("rule"), width: 1 };
    return { stroke: () => cssColour("soft"), font, labelFont: font, labelSize: 18, grid: rule, ticks: rule };
  }

  /** Choose the step, and in the raster also the neuron, at which a person clicks; the end of a drag is no click. */
  function chooseByClick(plot, id) {
    let pressedX = 0;
    plot.over.addEventListener("mousedown", (event) => {
      pressedX = event.clientX;
    });
    plot.over.addEventListener("click", (event) => {
      if (Math.abs(event.clientX - pressedX) > MAX_CLICK_DISTANCE) return;
      const step = Math.round(plot.posToVal(plot.cursor.left, "x"));
      const neuron = id === "raster" ? Math.round(plot.posToVal(plot.cursor.top, "y")) : state.neuron;
      choose({ step, neuron });
    });
  }

  /** Draw the vertical line at the chosen step. */
  function drawChosenStep(plot) {
    if (!isInRange(state.step)) return;
    const { ctx, bbox } = plot;
    const x = Math.round(plot.valToPos(state.step, "x", true));
    ctx.setLineDash([]);
    ctx.strokeStyle = cssColour("mark");
    ctx.lineWidth = devicePixelRatio;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }

  /** Draw the band of the chosen neuron, the chosen step, and a stroke for each spike. */
  function drawRaster(plot) {
    const { ctx, bbox } = plot;
    const group = chosenGroup();
    const rowHeight = bbox.height / group.size;
    const stepWidth = bbox.width / (state.range[1] - state.range[0]);
    ctx.save();
    clipToPlot(plot);
    drawNeuronBand(plot, rowHeight);
    drawChosenStep(plot);
    spikesByKind(group).forEach(({ steps, neurons }, kind) => {
      ctx.fillStyle = cssColour(SPIKE_KINDS[kind]);
      const { width, height } = rasterStroke(kind, stepWidth, rowHeight);
      const stroke = STROKES[kind];
      for (let i = 0; i < steps.length; i++) {
        if (!isInRange(steps[i])) continue;
        const x = plot.valToPos(steps[i], "x", true) - width / 2;
        const top = plot.valToPos(neurons[i], "y", true) - height / 2;
        ctx.fillRect(x, top + stroke.top * height, width, stroke.height * height);
      }
    });
    ctx.restore();
  }

  function clipToPlot({ ctx, bbox }) {
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
  }

  function drawNeuronBand(plot, rowHeight) {
    const { ctx, bbox } = plot;
    const height = Math.max(rowHeight, 6); // seen even where rows are lower than a pixel
    const middle = plot.valToPos(state.neuron, "y", true);
    ctx.fillStyle = cssColour("band");
    ctx.fillRect(bbox.left, middle - height / 2, bbox.width, height);
  }

  /** Return the size of a whole stroke in canvas pixels. The fractions and limits are chosen by hand. */
  function rasterStroke(kind, stepWidth, rowHeight) {
    const pixel = devicePixelRatio;
    const width = clamp(stepWidth * 0.6, pixel, 4 * pixel);
    if (SPIKE_KINDS[kind] === "both") {
      return { width, height: Math.max(rowHeight * 0.8, 3 * pixel) };
    }
    // Differences are what a person looks for: wider, and never too low to be seen.
    return { width: Math.max(width, 3 * pixel), height: Math.max(rowHeight * 0.9, 10 * pixel) };
  }

  /** Draw the chosen step, and the spikes of the chosen neuron as strokes at the upper edge. */
  function drawPotential(plot) {
    const { ctx, bbox } = plot;
    const width = POTENTIAL_STROKE_WIDTH * devicePixelRatio;
    const height = POTENTIAL_STROKE_HEIGHT * devicePixelRatio;
    ctx.save();
    drawChosenStep(plot);
    spikesByKind(chosenGroup()).forEach(({ steps, neurons }, kind) => {
      ctx.fillStyle = cssColour(SPIKE_KINDS[kind]);
      const stroke = STROKES[kind];
      for (let i = 0; i < steps.length; i++) {
        if (neurons[i] !== state.neuron || !isInRange(steps[i])) continue;
        const x = plot.valToPos(steps[i], "x", true) - width / 2;
        ctx.fillRect(x, bbox.top + stroke.top * height, width, stroke.height * height);
      }
    });
    ctx.restore();
  }

  /** Give both plots the data of the chosen neuron and recording, and write their titles. */
  function updatePlots() {
    const group = chosenGroup();
    const steps = Array.from({ length: group.steps }, (_, step) => step);
    plots.raster.setData([steps, steps.map(() => null)], false);
    updatePotentialPlot(group, steps);
    zoomToRange();
    updatePlotTitles(group);
  }

  function updatePotentialPlot(group, steps) {
    const potentials = chosenPotentials();
    element("potential").hidden = potentials === null;
    element("not-kept").hidden = potentials !== null;
    if (potentials === null) {
      element("not-kept").textContent = missingPotentialText(group);
      return;
    }
    const { reference, chip, threshold } = potentials;
    plots.potential.setData([steps, reference, chip, steps.map(() => threshold)], false);
  }

  function missingPotentialText(group) {
    if (group.isInput) return "An input line has no potential.";
    const counts = `${group.kept.length} of the ${group.size} neurons`;
    return `This page holds the potentials of ${counts}, those that differ most: ${group.kept.join(", ")}.`;
  }

  function updatePlotTitles(group) {
    const spikes = group.isInput ? "Events" : "Spikes";
    const rows = group.isInput ? "lines" : "neurons";
    const rasterTitle = `${spikes} of ${group.name}, ${formatCount(group.size)} ${rows}`;
    const potentialTitle = `Potential of ${rowWord(group)} ${state.neuron}`;
    element("raster-title").textContent = rasterTitle;
    element("potential-title").textContent = potentialTitle;
    element("raster").setAttribute("aria-label", `${rasterTitle}. The table below has their numbers.`);
    element("potential").setAttribute("aria-label", `${potentialTitle}. The line above has its values.`);
  }

  /* ---- zoom: the steps that both plots show --------------------------------------------------------------------- */

  /** Show the steps `from` to `to`, within the steps that there are, and not too few of them. */
  function zoom(from, to) {
    let low = Math.max(0, Math.floor(from));
    let high = Math.min(lastStep(), Math.ceil(to));
    if (high - low < MIN_ZOOM_SPAN) {
      const middle = low;
      low = Math.max(0, middle - MIN_ZOOM_SPAN / 2);
      high = Math.min(lastStep(), middle + MIN_ZOOM_SPAN / 2);
    }
    // Half a step more on each side, so that strokes at the edge are whole.
    const min = low - 0.5;
    const max = high + 0.5;
    state.range = [min, max];
    for (const plot of Object.values(plots)) plot.setScale("x", { min, max });
  }

  /** Show the range of the state, which may have been set without `zoom`; a range that `zoom` made stays as it is. */
  function zoomToRange() {
    const [low, high] = state.range;
    // The ends that `zoom` puts lie between two steps: the steps in sight are inside them.
    zoom(Math.ceil(low), Math.floor(high));
  }

  function zoomToAllSteps() {
    zoom(0, lastStep());
  }

  /** Multiply the shown span by a factor, around the chosen step if it is in sight. */
  function zoomBy(factor) {
    const [low, high] = state.range;
    const halfSpan = ((high - low) / 2) * factor;
    const middle = isInRange(state.step) ? state.step : (low + high) / 2;
    zoom(middle - halfSpan, middle + halfSpan);
  }

  /** Zoom both plots to what a person selected by dragging across one of them. */
  function zoomToSelection(plot) {
    const { left, width } = plot.select;
    if (width < MIN_SELECTION_WIDTH) return;
    const from = plot.posToVal(left, "x");
    const to = plot.posToVal(left + width, "x");
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); // false: without a call of this hook
    zoom(from, to);
  }

  /* ---- mesh: what each core counted in the chosen step ---------------------------------------------------------- */

  /* By the number of the core: {box, value}, the elements whose look and number change with the step. */
  const coreElements = new Map();

  /** Lay out a box for each tile of the mesh, as the chip has them, with a box in it for each core. */
  function createMesh() {
    const columns = sortedDistinct(data.cores.map((core) => core.tile[0]));
    const rows = sortedDistinct(data.cores.map((core) => core.tile[1]));
    // Columns and rows of the mesh in which no core of the program lies are left out.
    element("mesh").style.gridTemplateColumns = `repeat(${columns.length}, minmax(0, 1fr))`;
    const tileBoxes = new Map();
    for (const core of data.cores) {
      const tile = core.tile.join();
      if (!tileBoxes.has(tile)) {
        const tileBox = document.createElement("div");
        tileBox.className = "tile";
        tileBox.title = `tile ${tile}`;
        // The lines of a CSS grid count from 1.
        tileBox.style.gridColumn = columns.indexOf(core.tile[0]) + 1;
        tileBox.style.gridRow = rows.indexOf(core.tile[1]) + 1;
        tileBoxes.set(tile, tileBox);
        element("mesh").append(tileBox);
      }
      tileBoxes.get(tile).append(createCoreBox(core));
    }
  }

  function sortedDistinct(numbers) {
    return [...new Set(numbers)].sort((a, b) => a - b);
  }

  function createCoreBox(core) {
    const box = document.createElement("div");
    box.className = "core";
    const names = populations.filter((group) => group.cores.includes(core.core)).map((group) => group.name);
    box.title = `core ${core.core}, tile ${core.tile.join()}, phase ${core.phase}: ${names.join(", ")}`;
    const value = document.createElement("b");
    const label = document.createElement("small");
    label.textContent = `core ${core.core}`;
    box.append(value, label);
    coreElements.set(core.core, { box, value });
    return box;
  }

  /** Return the phase in which the chosen group runs. An input has no core, so any population of its axis will do. */
  function chosenPhase() {
    const cores = populations.filter((group) => group.axis === chosenGroup().axis).flatMap((group) => group.cores);
    return data.cores.find((core) => core.core === cores[0]).phase;
  }

  /** Write the counts of the chosen step into the cores of its phase; the other cores are idle and shown as such. */
  function drawMesh() {
    const phase = chosenPhase();
    const runningCores = data.cores.filter((core) => core.phase === phase);
    const counts = decodeArray(chosenRecording().activity[phase][state.quantity], Uint32Array);
    const largest = counts.reduce((a, b) => Math.max(a, b), 0);
    let total = 0;
    for (const core of data.cores) {
      const column = runningCores.indexOf(core);
      const count = column < 0 ? null : counts[state.step * runningCores.length + column];
      total += count ?? 0;
      drawCore(core, count, largest || 1);
    }
    const quantity = QUANTITY_TEXTS[data.quantities[state.quantity]];
    element("mesh-title").textContent = `Cores at step ${state.step} of phase ${phase}`;
    element("mesh-status").textContent =
      `${formatCount(total)} ${quantity} in this step; ` +
      `at most ${formatCount(largest || 1)} in a core and step of this recording.`;
  }

  /** Show the count of a core, and its share of the largest count as the depth of its colour; null if it is idle. */
  function drawCore(core, count, largest) {
    const { box, value } = coreElements.get(core.core);
    const share = count === null ? 0 : count / largest;
    value.textContent = formatCount(count);
    box.style.setProperty("--share", share);
    box.classList.toggle("much", share > LIGHT_TEXT_SHARE);
    box.classList.toggle("other", count === null);
    box.classList.toggle("here", chosenGroup().cores.includes(core.core));
  }

  /* ---- words and table ------------------------------------------------------------------------------------------ */

  const countFormat = new Intl.NumberFormat("en-US");

  /** Return a count with commas between thousands, or a dash for null. */
  function formatCount(count) {
    return count === null ? "–" : countFormat.format(count);
  }

  /** Return a value in the network's units with five digits. */
  function formatPotential(value) {
    if (Math.abs(value) >= 1e5) return value.toExponential(3);
    return Number(value.toPrecision(5)).toString();
  }

  function rowWord(group) {
    return group.isInput ? "line" : "neuron";
  }

  function classText(prediction) {
    return prediction < 0 ? "no class" : `class ${prediction}`;
  }

  function labelText(recording) {
    return recording.label === null ? "" : `, label ${recording.label}`;
  }

  /** Write the sentences above the plots: on the recording, and on the chosen neuron and step. */
  function writeSentences() {
    const recording = chosenRecording();
    const [reference, chip] = recording.predictions.map(classText);
    element("summary").textContent =
      `Recording ${recording.number}${labelText(recording)}: ` +
      `the network predicts ${reference}, the chip ${chip}. ${differencesText()}`;
    const group = chosenGroup();
    const place = `${group.name}, ${rowWord(group)} ${state.neuron}, step ${state.step}`;
    element("status").textContent = `${place}: ${spikeText(group)}.${potentialsText()}`;
  }

  function differencesText() {
    const count = differences().length;
    if (count === 0) return "Every spike is equal.";
    if (count === 1) return "One spike is on one side only.";
    return `${formatCount(count)} spikes are on one side only.`;
  }

  function spikeText(group) {
    const kind = spikeKindAt(group, state.neuron, state.step);
    if (group.isInput) return kind < 0 ? "no event" : "an event";
    return SPIKE_TEXTS[kind] ?? "no spike";
  }

  function potentialsText() {
    const potentials = chosenPotentials();
    if (potentials === null) return "";
    // No more decimals than a grade has: the page does not store them, and rounding up could put a potential on the
    // wrong side of its threshold.
    const decimals = clamp(Math.floor(-Math.log10(potentials.grade)), 0, MAX_DECIMALS);
    const textOf = (side) => formatPotential(Number(potentials[side][state.step].toFixed(decimals)));
    const threshold = formatPotential(potentials.threshold);
    return ` Potential of the network ${textOf("reference")}, of the chip ${textOf("chip")}; threshold ${threshold}.`;
  }

  /** Fill the table: for each population its spikes by kind, and the first step with a difference. */
  function drawTable() {
    element("table").tBodies[0].replaceChildren(...populations.map(createTableRow));
  }

  function createTableRow(group, index) {
    const [both, referenceOnly, chipOnly] = spikesByKind(group);
    const differingSteps = [...referenceOnly.steps, ...chipOnly.steps];
    const firstStep = differingSteps.length ? differingSteps.reduce((a, b) => Math.min(a, b)) : null;
    const row = document.createElement("tr");
    row.classList.toggle("chosen", index === state.population);
    row.append(createTableHead(group, index));
    for (const count of [both.steps.length, referenceOnly.steps.length, chipOnly.steps.length, firstStep]) {
      const cell = document.createElement("td");
      cell.textContent = formatCount(count);
      row.append(cell);
    }
    return row;
  }

  /** Return the name of a population as a button that chooses it. */
  function createTableHead(group, index) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = group.name;
    button.addEventListener("click", () => choose({ population: index }));
    const head = document.createElement("th");
    head.scope = "row";
    head.append(button);
    return head;
  }

  /* ---- changes of the state ------------------------------------------------------------------------------------- */

  /**
   * Change entries of the state, keep them within their limits, and draw what changed. `range` are the steps to show;
   * without it they stay, but for a group with another number of steps they are all steps.
   */
  function choose(change, range) {
    const previous = { ...state };
    const previousSteps = chosenGroup().steps;
    Object.assign(state, change);
    const group = chosenGroup();
    state.neuron = toIndex(state.neuron, group.size);
    state.step = toIndex(state.step, group.steps);
    if (range) state.range = range;
    else if (group.steps !== previousSteps) state.range = [0, lastStep()];

    const needsNewData = ["recording", "population", "neuron"].some((name) => state[name] !== previous[name]);
    if (needsNewData) {
      drawTable();
      updatePlots();
    } else if (range) {
      zoom(...range);
    }
    redrawPlots();
    updateControls();
    drawMesh();
    writeSentences();
  }

  /** Return the index nearest to a number that a person gave, in a list of this length; 0 for what is no number. */
  function toIndex(value, length) {
    return clamp(Math.round(value) || 0, 0, length - 1);
  }

  /** Draw spikes and the chosen step again; false: without building the lines of the series again. */
  function redrawPlots() {
    for (const plot of Object.values(plots)) plot.redraw(false);
  }

  function updateControls() {
    const group = chosenGroup();
    element("recording").value = state.recording;
    element("population").value = state.population;
    element("quantity").value = state.quantity;
    element("neuron").value = state.neuron;
    element("neuron").max = group.size - 1;
    // The maximum first: a range input lowers a value that is above it.
    element("step").max = lastStep();
    element("step").value = state.step;
    element("step-shown").textContent = `${state.step} of ${lastStep()}`;
    for (const id of ["first", "next", "previous"]) element(id).disabled = differences().length === 0;
  }

  function goToDifference(difference) {
    if (!difference) return; // the recording has none
    const { population, neuron, step } = difference;
    choose({ population, neuron, step }, [step - STEPS_AROUND_DIFFERENCE, step + STEPS_AROUND_DIFFERENCE]);
  }

  function goToFirstDifference() {
    goToDifference(differences()[0]);
  }

  /** Go to the first difference after the chosen place, or stay at the last one. */
  function goToNextDifference() {
    const place = chosenPlace();
    const next = differences().find((difference) => compareInTime(difference, place) > 0);
    goToDifference(next ?? differences().at(-1));
  }

  /** Go to the last difference before the chosen place, or stay at the first one. */
  function goToPreviousDifference() {
    const place = chosenPlace();
    const previous = differences().filter((difference) => compareInTime(difference, place) < 0).at(-1);
    goToDifference(previous ?? differences()[0]);
  }

  let playTimer = null;

  /** Go on step by step at the chosen speed until the last step; from the last step, start at the first. */
  function startPlaying() {
    stopPlaying();
    showPlaying(true);
    if (state.step >= lastStep()) choose({ step: 0 });
    const stepsPerSecond = Number(element("speed").value);
    playTimer = setInterval(() => {
      if (state.step >= lastStep()) stopPlaying();
      else choose({ step: state.step + 1 });
    }, 1000 / stepsPerSecond);
  }

  function stopPlaying() {
    clearInterval(playTimer);
    playTimer = null;
    showPlaying(false);
  }

  function togglePlaying() {
    if (playTimer === null) startPlaying();
    else stopPlaying();
  }

  function showPlaying(isPlaying) {
    element("play").setAttribute("aria-pressed", String(isPlaying));
    element("play").textContent = isPlaying ? "Pause" : "Play";
  }

  /* ---- controls and keys ---------------------------------------------------------------------------------------- */

  const stepsOfArrow = (event) => (event.shiftKey ? STEPS_OF_SHIFT_ARROW : 1);

  const KEY_ACTIONS = {
    f: goToFirstDifference,
    n: goToNextDifference,
    p: goToPreviousDifference,
    j: () => choose({ neuron: state.neuron + 1 }),
    k: () => choose({ neuron: state.neuron - 1 }),
    "[": () => choose({ recording: Math.max(state.recording - 1, 0) }),
    "]": () => choose({ recording: Math.min(state.recording + 1, recordings.length - 1) }),
    "+": () => zoomBy(0.5),
    "=": () => zoomBy(0.5), // the key of + without Shift
    "-": () => zoomBy(2),
    0: zoomToAllSteps,
    " ": togglePlaying,
    ArrowLeft: (event) => choose({ step: state.step - stepsOfArrow(event) }),
    ArrowRight: (event) => choose({ step: state.step + stepsOfArrow(event) }),
  };

  function listenToControls() {
    // The ids of these inputs are names of entries of the state.
    for (const id of ["recording", "population", "quantity", "neuron", "step"]) {
      element(id).addEventListener("input", (event) => choose({ [id]: Number(event.target.value) }));
    }
    element("first").addEventListener("click", goToFirstDifference);
    element("next").addEventListener("click", goToNextDifference);
    element("previous").addEventListener("click", goToPreviousDifference);
    element("play").addEventListener("click", togglePlaying);
    element("speed").addEventListener("input", () => {
      if (playTimer !== null) startPlaying(); // again, at the new speed
    });
    element("closer").addEventListener("click", () => zoomBy(0.5));
    element("wider").addEventListener("click", () => zoomBy(2));
    element("whole").addEventListener("click", zoomToAllSteps);
    // Enter in the field of the neuron would load the page again.
    document.querySelector("form").addEventListener("submit", (event) => event.preventDefault());
  }

  function listenToKeys() {
    document.addEventListener("keydown", (event) => {
      if (!(event.key in KEY_ACTIONS)) return;
      // The browser and the focused control have keys of their own.
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target.closest("input, select, textarea, summary")) return;
      if (event.key === " " && event.target.closest("button")) return;
      event.preventDefault();
      KEY_ACTIONS[event.key](event);
    });
  }

  /** Follow changes of the screen: between light and dark, and in width. */
  function listenToScreen() {
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawPlots);
    new ResizeObserver(() => {
      // Of the section, as the box of a hidden plot has no width.
      const width = element("plots").clientWidth;
      for (const [id, plot] of Object.entries(plots)) {
        if (width && width !== plot.width) plot.setSize({ width, height: PLOT_HEIGHTS[id] });
      }
    }).observe(element("plots"));
  }

  /* ---- start ---------------------------------------------------------------------------------------------------- */

  function fillSelects() {
    fillSelect("recording", recordings.map((recording) => `${recording.number}${labelText(recording)}`));
    fillSelect("population", groups.map((group) => `${group.name}${group.isInput ? " (input)" : ""}`));
    fillSelect("quantity", data.quantities.map((name) => QUANTITY_TEXTS[name]));
  }

  /** Give a select its options; the value of an option is its index. */
  function fillSelect(id, texts) {
    element(id).replaceChildren(...texts.map((text, index) => new Option(text, index)));
  }

  function writeAbout() {
    element("about").textContent =
      `${recordings.length} of ${formatCount(data.samples)} recordings are on this page. ` +
      "Potentials are in the units of the network, in 65,536 grades. " +
      "Synaptic operations, spikes and packets are counts of the simulation.";
  }

  /** Show the first difference with all steps around it; without a difference, the beginning of the first recording. */
  function showFirstDifference() {
    const { first } = data;
    const recording = recordings.findIndex(({ number }) => number === first?.recording);
    state.range = [0, lastStep()];
    state.recording = -1; // no recording, so that `choose` sees a change and draws everything
    choose({ recording: Math.max(recording, 0) });
    if (first) choose({ population: indexOfGroup(first.population), neuron: first.neuron, step: first.step });
  }

  fillSelects();
  writeAbout();
  createPlots();
  createMesh();
  listenToControls();
  listenToKeys();
  listenToScreen();
  showFirstDifference();
})();
