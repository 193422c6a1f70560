"use strict";
/*
 * The viewer: one state, and what is drawn from it. A person picks a recording, a population and a neuron; plots share
 * their steps; differences between the network and the chip are walked through in the order in which they arise.
 *
 * Arrays in the data are little-endian, in base64. Spikes are numbers `step * size + neuron` in ascending order, of the
 * network and of the chip. Potentials are grades, `low + grade * value`: the network's neurons first, then the chip's.
 */
(() => {
  const find = (id) => document.getElementById(id);
  const data = JSON.parse(find("data").textContent);
  const array = (text, Kind) => new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const SIDES = ["both", "reference", "chip"];
  const WORDS = { synaptic_ops: "synaptic operations", spikes: "spikes", packets_received: "packets received" };
  const AROUND = 30; // steps to each side of a difference that is jumped to
  const number = new Intl.NumberFormat("en-US");
  const short = (value) => (Math.abs(value) >= 1e5 ? value.toExponential(3) : Number(value.toPrecision(5)).toString());
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  const state = { recording: 0, population: 0, neuron: 0, step: 0, range: [0, 1], quantity: 0, timer: null };
  const recording = () => data.recordings[state.recording];
  const population = () => data.populations[state.population];
  data.recordings.sort((one, other) => one.number - other.number);
  const own = data.populations;
  data.populations = [...own, ...data.inputs.map((one) => ({ ...one, input: true, cores: [] }))];
  const indexOf = (name) => data.populations.findIndex((one) => one.name === name);

  /* Split two ascending lists of numbers into those of both, of the first alone, of the second alone. */
  function compared(one, other) {
    const found = [[], [], []];
    for (let i = 0, j = 0; i < one.length || j < other.length; ) {
      if (j >= other.length || one[i] < other[j]) found[1].push(one[i++]);
      else if (i >= one.length || other[j] < one[i]) found[2].push(other[j++]);
      else {
        found[0].push(one[i++]);
        j++;
      }
    }
    return found;
  }

  /* Spikes of a population in the recording: by side, {steps, neurons}. */
  const decoded = new Map();
  function spikes(name) {
    const key = `${state.recording}/${name}`;
    if (!decoded.has(key)) {
      const size = data.populations[indexOf(name)].size;
      const lists = recording().spikes[name].map((text) => array(text, Uint32Array));
      const sides = compared(...lists).map((given) => {
        const steps = new Uint32Array(given.length);
        const neurons = new Uint32Array(given.length);
        for (let i = 0; i < given.length; i++) {
          steps[i] = Math.floor(given[i] / size);
          neurons[i] = given[i] % size;
        }
        return { steps, neurons };
      });
      decoded.set(key, sides);
    }
    return decoded.get(key);
  }

  /* All differences of the recording in the order in which they arise: phase by phase, then step by step. */
  const walked = new Map();
  function differences() {
    if (!walked.has(state.recording)) {
      const rows = [];
      own.forEach((one, rank) => {
        spikes(one.name).slice(1).forEach(({ steps, neurons }) => {
          for (let i = 0; i < steps.length; i++) {
            rows.push([data.phases.indexOf(one.axis), steps[i], rank, neurons[i], indexOf(one.name)]);
          }
        });
      });
      walked.set(state.recording, rows.sort(before));
    }
    return walked.get(state.recording);
  }
  function before(a, b) {
    for (let i = 0; i < 4; i++) if (a[i] !== b[i]) return a[i] - b[i];
    return 0;
  }
  function here() {
    const one = population();
    return [data.phases.indexOf(one.axis), state.step, own.indexOf(one), state.neuron];
  }

  /* Potentials of the neuron, {reference, chip, threshold, grade}, in steps of grade; null where the page does not hold them. */
  function potentials() {
    const one = population();
    const row = one.input ? -1 : one.kept.indexOf(state.neuron);
    if (row < 0) return null;
    const held = recording().potentials[one.name];
    const values = array(held.values, Uint16Array);
    const start = (side) => (side * one.kept.length + row) * one.steps;
    const side = (i) => Array.from(values.subarray(start(i), start(i) + one.steps), (v) => held.low + held.grade * v);
    return { reference: side(0), chip: side(1), threshold: one.thresholds[row], grade: held.grade };
  }

  /* Which sides spike at a neuron and step: an index into SIDES, or -1. */
  function spiking(name, neuron, step) {
    return spikes(name).findIndex(({ steps, neurons }) => {
      for (let i = 0; i < steps.length && steps[i] <= step; i++) {
        if (steps[i] === step && neurons[i] === neuron) return true;
      }
      return false;
    });
  }

  /* ---- plots ---------------------------------------------------------------------------------------------------- */

  const plots = {};
  const HEIGHTS = { raster: 320, potential: 240 };
  let zooming = false;

  function axes(label, side) {
    const look = { stroke: () => colour("soft"), font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    const lines = { grid: { stroke: () => colour("rule"), width: 1 }, ticks: { stroke: () => colour("rule"), width: 1 } };
    return [
      { ...look, ...lines, label: "step", labelSize: 18, size: 34, space: 60, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000] },
      { ...look, ...lines, label, labelSize: 18, size: 52, ...side },
    ];
  }

  function plot(id, series, y, label, side, draw) {
    const box = find(id);
    const options = {
      width: Math.max(box.clientWidth, 200),
      height: HEIGHTS[id],
      padding: [8, 8, 0, 0],
      cursor: { sync: { key: "steps", setSeries: false }, drag: { x: true, y: false, setScale: true }, points: { show: false } },
      legend: { show: false },
      scales: { x: { time: false, range: () => state.range }, y },
      axes: axes(label, side),
      series,
      hooks: { draw: [draw], setSelect: [zoomed] },
    };
    const made = new uPlot(options, [[0, 1], ...series.slice(1).map(() => [null, null])], box);
    made.over.addEventListener("click", picked(made, id));
    made.over.addEventListener("dblclick", () => zoom(0, population().steps - 1));
    return made;
  }

  /* uPlot zooms the plot that was dragged across; the steps are those of both. */
  function zoomed(made) {
    if (zooming || made.select.width < 4) return;
    const from = made.posToVal(made.select.left, "x");
    const to = made.posToVal(made.select.left + made.select.width, "x");
    made.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    zoom(from, to);
  }

  function zoom(from, to) {
    const last = population().steps - 1;
    let [low, high] = [Math.max(0, Math.floor(from)), Math.min(last, Math.ceil(to))];
    if (high - low < 4) [low, high] = [Math.max(0, low - 2), Math.min(last, low + 2)];
    state.range = [low - 0.5, high + 0.5];
    zooming = true;
    for (const made of Object.values(plots)) made.setScale("x", { min: state.range[0], max: state.range[1] });
    zooming = false;
  }

  function zoomBy(factor) {
    const [low, high] = state.range;
    const half = ((high - low) / 2) * factor;
    const middle = state.step >= low && state.step <= high ? state.step : (low + high) / 2;
    zoom(middle - half, middle + half);
  }

  function picked(made, id) {
    let down = 0;
    made.over.addEventListener("mousedown", (event) => (down = event.clientX));
    return (event) => {
      if (Math.abs(event.clientX - down) > 3) return; // the end of a drag
      const step = Math.round(made.posToVal(made.cursor.left, "x"));
      const neuron = id === "raster" ? Math.round(made.posToVal(made.cursor.top, "y")) : state.neuron;
      choose({ step, neuron });
    };
  }

  function drawStep(made) {
    const { ctx, bbox } = made;
    if (state.step < state.range[0] || state.step > state.range[1]) return;
    const x = Math.round(made.valToPos(state.step, "x", true));
    ctx.setLineDash([]);
    ctx.strokeStyle = colour("mark");
    ctx.lineWidth = devicePixelRatio;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }

  /* A stroke for each spike: whole where both sides have it, the upper half of the network's, the lower of the chip's. */
  function drawRaster(made) {
    const { ctx, bbox } = made;
    const one = population();
    const row = bbox.height / one.size;
    const common = Math.max(row * 0.8, 3 * devicePixelRatio);
    const column = bbox.width / (state.range[1] - state.range[0]);
    const narrow = Math.min(Math.max(column * 0.6, devicePixelRatio), 4 * devicePixelRatio);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = colour("band");
    ctx.fillRect(bbox.left, made.valToPos(state.neuron, "y", true) - Math.max(row, 6) / 2, bbox.width, Math.max(row, 6));
    drawStep(made);
    spikes(one.name).forEach(({ steps, neurons }, side) => {
      ctx.fillStyle = colour(SIDES[side]);
      // What is on one side only is what a person looks for: wider, and never too low to be seen.
      const height = side ? Math.max(row * 0.9, 10 * devicePixelRatio) : common;
      const width = side ? Math.max(narrow, 3 * devicePixelRatio) : narrow;
      const [top, part] = [[-0.5, 1], [-0.5, 0.5], [0, 0.5]][side];
      for (let i = 0; i < steps.length; i++) {
        if (steps[i] < state.range[0] || steps[i] > state.range[1]) continue;
        const x = made.valToPos(steps[i], "x", true) - width / 2;
        const y = made.valToPos(neurons[i], "y", true) + top * height;
        ctx.fillRect(x, y, width, part * height);
      }
    });
    ctx.restore();
  }

  /* The spikes of the neuron as marks at the upper edge, like those of the raster. */
  function drawPotential(made) {
    const { ctx, bbox } = made;
    const high = 12 * devicePixelRatio;
    ctx.save();
    drawStep(made);
    spikes(population().name).forEach(({ steps, neurons }, side) => {
      ctx.fillStyle = colour(SIDES[side]);
      const [top, part] = [[0, 1], [0, 0.5], [0.5, 0.5]][side];
      for (let i = 0; i < steps.length; i++) {
        if (neurons[i] !== state.neuron || steps[i] < state.range[0] || steps[i] > state.range[1]) continue;
        ctx.fillRect(made.valToPos(steps[i], "x", true) - devicePixelRatio, bbox.top + top * high, 2 * devicePixelRatio, part * high);
      }
    });
    ctx.restore();
  }

  /* ---- mesh ----------------------------------------------------------------------------------------------------- */

  const coreBoxes = new Map();
  /* The phase in which the population steps. */
  function phase() {
    const cores = own.filter((one) => one.axis === population().axis).flatMap((one) => one.cores);
    return data.cores.find((core) => core.core === cores[0]).phase;
  }

  function buildMesh() {
    const [xs, ys] = [0, 1].map((i) => [...new Set(data.cores.map((core) => core.tile[i]))].sort((a, b) => a - b));
    const mesh = find("mesh");
    mesh.style.gridTemplateColumns = `repeat(${xs.length}, minmax(0, 1fr))`;
    const tiles = new Map();
    for (const core of data.cores) {
      const key = core.tile.join();
      if (!tiles.has(key)) {
        const tile = document.createElement("div");
        tile.className = "tile";
        tile.title = `tile ${key}`;
        tile.style.gridColumn = xs.indexOf(core.tile[0]) + 1;
        tile.style.gridRow = ys.indexOf(core.tile[1]) + 1;
        tiles.set(key, tile);
        mesh.append(tile);
      }
      const box = document.createElement("div");
      box.className = "core";
      const held = own.filter((one) => one.cores.includes(core.core)).map((one) => one.name);
      box.title = `core ${core.core}, tile ${key}, phase ${core.phase}: ${held.join(", ")}`;
      const value = document.createElement("b");
      const name = document.createElement("small");
      name.textContent = `core ${core.core}`;
      box.append(value, name);
      tiles.get(key).append(box);
      coreBoxes.set(core.core, { box, value });
    }
  }

  function drawMesh() {
    const now = phase();
    const cores = data.cores.filter((core) => core.phase === now);
    const values = array(recording().activity[now][state.quantity], Uint32Array);
    const most = values.reduce((a, b) => Math.max(a, b), 0) || 1;
    let total = 0;
    for (const core of data.cores) {
      const { box, value } = coreBoxes.get(core.core);
      const column = cores.indexOf(core);
      const count = column < 0 ? null : values[state.step * cores.length + column];
      total += count ?? 0;
      value.textContent = count === null ? "–" : number.format(count);
      box.style.setProperty("--share", count === null ? 0 : count / most);
      box.classList.toggle("much", count !== null && count / most > 0.6);
      box.classList.toggle("other", count === null);
      box.classList.toggle("here", population().cores.includes(core.core));
    }
    const word = WORDS[data.quantities[state.quantity]];
    find("mesh-title").textContent = `Cores at step ${state.step} of phase ${now}`;
    find("mesh-status").textContent =
      `${number.format(total)} ${word} in this step; at most ${number.format(most)} in a core and step of this recording.`;
  }

  /* ---- words ---------------------------------------------------------------------------------------------------- */

  function say() {
    const one = recording();
    const label = one.label === null ? "" : `, label ${one.label}`;
    const named = (prediction) => (prediction < 0 ? "no class" : `class ${prediction}`);
    const found = differences().length;
    const many = found === 1 ? "One spike is" : `${number.format(found)} spikes are`;
    const differs = found ? `${many} on one side only.` : "Every spike is equal.";
    find("summary").textContent =
      `Recording ${one.number}${label}: the network predicts ${named(one.predictions[0])}, the chip ${named(one.predictions[1])}. ${differs}`;
    find("status").textContent = neuronNow();
  }

  function neuronNow() {
    const one = population();
    const what = one.input ? "line" : "neuron";
    const side = spiking(one.name, state.neuron, state.step);
    const spike = one.input
      ? side < 0 ? "no event" : "an event"
      : ["spikes on both sides", "only the network spikes", "only the chip spikes"][side] ?? "no spike";
    const held = potentials();
    const decimals = held && Math.min(Math.max(Math.floor(-Math.log10(held.grade)), 0), 20);
    const shown = (value) => short(Number(value.toFixed(decimals)));
    const values = held
      ? ` Potential of the network ${shown(held.reference[state.step])}, of the chip ${shown(held.chip[state.step])}; threshold ${short(held.threshold)}.`
      : "";
    return `${one.name}, ${what} ${state.neuron}, step ${state.step}: ${spike}.${values}`;
  }

  function drawTable() {
    const rows = own.map((one) => {
      const [both, reference, chip] = spikes(one.name);
      const steps = [...reference.steps, ...chip.steps];
      const row = document.createElement("tr");
      row.classList.toggle("chosen", one === population());
      const head = document.createElement("th");
      head.scope = "row";
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = one.name;
      button.addEventListener("click", () => choose({ population: indexOf(one.name) }));
      head.append(button);
      row.append(head);
      const first = steps.length ? steps.reduce((a, b) => Math.min(a, b)) : null;
      for (const value of [both.steps.length, reference.steps.length, chip.steps.length, first]) {
        const cell = document.createElement("td");
        cell.textContent = value === null ? "–" : number.format(value);
        row.append(cell);
      }
      return row;
    });
    find("table").tBodies[0].replaceChildren(...rows);
  }

  /* ---- from the state to the page ------------------------------------------------------------------------------- */

  function drawPlots() {
    const one = population();
    const steps = Array.from({ length: one.steps }, (_, i) => i);
    plots.raster.setData([steps, steps.map(() => null)], false);
    plots.raster.setScale("y", { min: -0.5, max: one.size - 0.5 });
    const held = potentials();
    find("potential").hidden = held === null;
    find("not-kept").hidden = held !== null;
    if (held) {
      plots.potential.setData([steps, held.reference, held.chip, steps.map(() => held.threshold)], false);
      const values = [...held.reference, ...held.chip, held.threshold];
      const [low, high] = [Math.min(...values), Math.max(...values)];
      const room = (high - low) * 0.08 || 1;
      plots.potential.setScale("y", { min: low - room, max: high + 2 * room });
    } else {
      find("not-kept").textContent = one.input
        ? "An input line has no potential."
        : `This page holds the potentials of ${one.kept.length} of the ${one.size} neurons, those that differ most: ${one.kept.join(", ")}.`;
    }
    zoom(...state.range.map(Math.round));
    const what = one.input ? "Events of" : "Spikes of";
    find("raster-title").textContent = `${what} ${one.name}, ${number.format(one.size)} ${one.input ? "lines" : "neurons"}`;
    find("potential-title").textContent = `Potential of ${one.input ? "line" : "neuron"} ${state.neuron}`;
    find("raster").setAttribute("aria-label", find("raster-title").textContent + ". The table below has their numbers.");
    find("potential").setAttribute("aria-label", find("potential-title").textContent + ". The line above has its values.");
  }

  function show() {
    const one = population();
    find("recording").value = state.recording;
    find("population").value = state.population;
    find("neuron").value = state.neuron;
    find("neuron").max = one.size - 1;
    find("step").max = one.steps - 1;
    find("step").value = state.step;
    find("step-shown").textContent = `${state.step} of ${one.steps - 1}`;
    find("quantity").value = state.quantity;
    const rows = differences();
    find("first").disabled = find("next").disabled = find("previous").disabled = rows.length === 0;
  }

  /* Change the state, keep it within its limits, and draw what changed. */
  function choose(change, range) {
    const was = { ...state };
    Object.assign(state, change);
    const one = population();
    const within = (value, most) => Math.min(Math.max(Math.round(value) || 0, 0), most);
    state.neuron = within(state.neuron, one.size - 1);
    state.step = within(state.step, one.steps - 1);
    const other = one.steps !== data.populations[was.population].steps;
    if (range) state.range = range;
    else if (other) state.range = [0, one.steps - 1];
    if (was.recording !== state.recording || was.population !== state.population || was.neuron !== state.neuron) {
      drawTable();
      drawPlots();
    } else if (range) {
      zoom(...range);
    }
    for (const made of Object.values(plots)) made.redraw(false);
    show();
    drawMesh();
    say();
  }

  function goTo(row) {
    if (row) choose({ population: row[4], neuron: row[3], step: row[1] }, [row[1] - AROUND, row[1] + AROUND]);
  }
  function follow(direction) {
    const rows = differences();
    const now = here();
    if (direction > 0) goTo(rows.find((row) => before(row, now) > 0) ?? rows[rows.length - 1]);
    else goTo(rows.filter((row) => before(row, now) < 0).pop() ?? rows[0]);
  }

  function play(on) {
    clearInterval(state.timer);
    state.timer = null;
    find("play").setAttribute("aria-pressed", String(on));
    find("play").textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (state.step >= population().steps - 1) choose({ step: 0 });
    state.timer = setInterval(() => {
      if (state.step >= population().steps - 1) play(false);
      else choose({ step: state.step + 1 });
    }, 1000 / Number(find("speed").value));
  }

  /* ---- controls ------------------------------------------------------------------------------------------------- */

  function options(id, names) {
    find(id).replaceChildren(...names.map((name, value) => new Option(name, value)));
  }

  const KEYS = {
    f: () => goTo(differences()[0]),
    n: () => follow(1),
    p: () => follow(-1),
    j: () => choose({ neuron: state.neuron + 1 }),
    k: () => choose({ neuron: state.neuron - 1 }),
    "[": () => choose({ recording: Math.max(state.recording - 1, 0) }),
    "]": () => choose({ recording: Math.min(state.recording + 1, data.recordings.length - 1) }),
    "+": () => zoomBy(0.5),
    "=": () => zoomBy(0.5),
    "-": () => zoomBy(2),
    0: () => zoom(0, population().steps - 1),
    " ": () => play(state.timer === null),
    ArrowLeft: (event) => choose({ step: state.step - (event.shiftKey ? 10 : 1) }),
    ArrowRight: (event) => choose({ step: state.step + (event.shiftKey ? 10 : 1) }),
  };

  function listen() {
    for (const id of ["recording", "population", "quantity", "neuron", "step"]) {
      find(id).addEventListener("input", (event) => choose({ [id]: Number(event.target.value) }));
    }
    find("first").addEventListener("click", KEYS.f);
    find("next").addEventListener("click", KEYS.n);
    find("previous").addEventListener("click", KEYS.p);
    find("play").addEventListener("click", KEYS[" "]);
    find("speed").addEventListener("input", () => state.timer !== null && play(true));
    find("closer").addEventListener("click", KEYS["+"]);
    find("wider").addEventListener("click", KEYS["-"]);
    find("whole").addEventListener("click", KEYS[0]);
    document.querySelector("form").addEventListener("submit", (event) => event.preventDefault());
    document.addEventListener("keydown", (event) => {
      const typed = event.target.closest("input, select, textarea, summary");
      const pressed = event.key === " " && event.target.closest("button");
      if (typed || pressed || event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS)) return;
      event.preventDefault();
      KEYS[event.key](event);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const made of Object.values(plots)) made.redraw(false);
    });
    new ResizeObserver(() => {
      for (const [id, made] of Object.entries(plots)) {
        const width = find("plots").clientWidth;
        if (width && width !== made.width) made.setSize({ width, height: HEIGHTS[id] });
      }
    }).observe(find("plots"));
  }

  function begin() {
    options("recording", data.recordings.map((one) => `${one.number}${one.label === null ? "" : `, label ${one.label}`}`));
    options("population", data.populations.map((one) => `${one.name}${one.input ? " (input)" : ""}`));
    options("quantity", data.quantities.map((name) => WORDS[name]));
    find("about").textContent =
      `${data.recordings.length} of ${number.format(data.samples)} recordings are on this page. Potentials are in the units of the ` +
      "network, in 65,536 grades. Synaptic operations, spikes and packets are counts of the simulation.";
    const line = (name, dash) => ({ label: name, stroke: () => colour(name), width: 1.5, dash, points: { show: false } });
    plots.raster = plot("raster", [{}, { label: "neuron", paths: () => null, points: { show: false } }], { dir: -1, range: (made, low, high) => [low, high] }, "neuron", { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000] }, drawRaster);
    plots.potential = plot("potential", [{}, line("reference"), line("chip", [6, 4]), { ...line("soft", [2, 4]), label: "threshold" }], { range: (made, low, high) => [low, high] }, "potential", {}, drawPotential);
    buildMesh();
    listen();
    const start = Math.max(data.recordings.findIndex((one) => one.number === data.first?.recording), 0);
    state.range = [0, population().steps - 1];
    state.recording = -1; // so that everything is drawn
    choose({ recording: start });
    const first = data.first;
    if (first) {
      choose({ population: indexOf(first.population), neuron: first.neuron, step: first.step });
    }
  }

  begin();
})();
