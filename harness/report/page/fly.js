/* The page that flies: a slider is moved, the system flies again, and plots, replay and verdicts show
 * the new rows. */
"use strict";
(async () => {
  const section = document.getElementById("live"), part = (name) => section.querySelector(name);
  const say = (text) => { part(".outcome").textContent = text; };
  const lacking = [["WebAssembly", typeof WebAssembly], ["DecompressionStream", typeof DecompressionStream]]
    .filter(([, type]) => type === "undefined").map(([name]) => name);
  if (lacking.length) {
    say(`This browser cannot run the system: it has no ${lacking.join(" and no ")}. The report shows the run of the file.`);
    section.classList.add("unable");
    for (const each of section.querySelectorAll("input, button")) each.disabled = true;
    return;
  }

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const about = JSON.parse(document.getElementById("flight").textContent);
  for (const [, , told] of about.operations)
    if (told.index) for (const each of told.index) if (typeof each.t === "number") each.t = about.lists[each.t];
  const system = await Flight.open(await Flight.unpacked(bytes(document.getElementById("wasm").textContent)), about);
  const stored = JSON.parse(document.getElementById("arrays").textContent);
  const original = JSON.parse(document.getElementById("data").textContent);

  /* ---- settings ---- */
  const sliders = [...section.querySelectorAll(".slider")].map((box) => {
    const { place, constant, low, high, value } = box.dataset, [range, exact] = box.querySelectorAll("input");
    const own = { box, range, exact, place: Number(place), constant: Number(constant), low: Number(low), high: Number(high), base: Number(value) };
    own.now = own.base;
    return own;
  });
  const settingsNow = () => sliders.map((s) => s.now);
  const unchanged = (settings) => settings.every((value, k) => value === sliders[k].base);
  const valuesOf = (settings) => {
    const values = Float64Array.from(about.values);
    settings.forEach((value, k) => { values[sliders[k].place] = value; });
    return values;
  };
  const constantsOf = (settings) => {
    const constants = Float64Array.from(about.constants);
    settings.forEach((value, k) => { if (sliders[k].constant >= 0) constants[sliders[k].constant] = value; });
    return constants;
  };
  const show = (slider) => {
    const steps = Number(slider.range.max), at = Math.round((steps * (slider.now - slider.low)) / (slider.high - slider.low));
    slider.range.value = at;
    slider.range.setAttribute("aria-valuetext", Judge.g(slider.now));
    slider.exact.value = Number(slider.now.toPrecision(10));
    slider.box.classList.toggle("moved", slider.now !== slider.base);
  };
  const put = (slider, value) => {
    slider.now = Math.min(slider.high, Math.max(slider.low, value));
    show(slider);
  };

  /* ---- what a flight brings ---- */
  const gathered = (rows, width, values, [shape, columns]) => {
    const out = Flight.make([rows, ...shape]), n = columns.length;
    for (let k = 0; k < rows; k++) for (let i = 0; i < n; i++) out.data[k * n + i] = values[k * width + columns[i]];
    return out;
  };
  const known = (table, name, kind) => table[name] || (() => { throw new Error(`there is no ${kind} ${name}`); })();
  const rowsOf = (flight, constants) => ({
    time: flight.time, complete: flight.complete,
    column: (name) => gathered(flight.rows, system.width, flight.values, known(about.names, name, "variable")),
    parameter: (name) => {
      const [shape, places] = known(about.parameters, name, "parameter");
      return Flight.make(shape, Float64Array.from(places, (k) => constants[k]));
    },
  });
  const verdictsOf = (flight, constants) => {
    const rows = rowsOf(flight, constants);
    return about.requirements.map((each) => ({ name: each.name, ...(flight.rows ? Judge.judged(rows, each) : { kind: "none", verdict: "not judged", detail: "nothing was recorded", time: null }) }));
  };

  /* the arrays of the page over the rows of a flight; one that ended early stays where it ended */
  const arraysOf = (flight, constants) => {
    const all = system.rows, values = new Float64Array(all * system.width);
    values.set(flight.values);
    const last = flight.values.subarray((flight.rows - 1) * system.width);
    for (let k = flight.rows; k < all; k++) values.set(last, k * system.width);
    const time = Float64Array.from({ length: all }, (_, k) => system.timeOf(k)), end = time[flight.rows - 1];
    const value = Flight.evaluator(about.operations, {
      values: Flight.table(all, system.width, values), time: Flight.make([all], time), parameters: Flight.make([1, constants.length], constants),
    });
    const found = { ...stored };
    for (const [name, place] of Object.entries(about.made)) {
      const { shape, data } = value(place);
      found[name] = { shape, data: Float32Array.from(data) };
    }
    for (const { names, places, points } of about.curves) {
      const [x, y] = [value(places.x).data, value(places.y).data];
      let count = x.length;
      while (count > 1 && x[count - 1] > end) count--;
      const rows = Flight.keptRows(y.subarray(0, count), points);
      for (const [key, from] of [["x", x], ["y", y]])
        found[names[key]] = { shape: [rows.length], data: Float32Array.from(rows, (k) => from[k]) };
    }
    return found;
  };

  /* events, limits and still values of the file are not those of another flight */
  const fixed = new Set(about.fixed), stays = (curve) => fixed.has(curve.x) || fixed.has(curve.y);
  const dataOf = (flight, constants, arrays, verdicts) => {
    const data = structuredClone(original);
    if (data.scene) data.scene = Course.told(data.scene, numbersOf(arrays), flight.time.at(-1), verdicts);
    for (const section_ of data.figures)
      for (const figure of section_.figures)
        for (const plot of figure.plots) {
          plot.curves = plot.curves.filter((c) => !(c.marker && stays(c))); /* a mark with a number of the file */
          if (plot.curves.some(stays)) plot.title = `${plot.title || figure.title} (of the run in the file)`;
        }
    for (const component of data.signals)
      for (const each of component.fixed) each.value = still(flight, `${component.name}.${each.variable}`, each.value);
    return data;
  };
  const still = (flight, name, before) => {
    const found = about.names[name];
    if (!found) return before;
    const texts = found[1].map((column) => {
      let low = Infinity, high = -Infinity;
      for (let k = 0; k < flight.rows; k++) {
        const v = flight.values[k * system.width + column];
        if (v < low) low = v;
        if (v > high) high = v;
      }
      return low === high ? Judge.g(low) : `${Judge.g(low)} to ${Judge.g(high)}`;
    });
    return texts.length === 1 ? texts[0] : `[${texts.join(", ")}]`;
  };

  /* the numbers of an array, of this flight or of the file */
  const numbersOf = (arrays) => (name) => {
    const { data } = arrays[name];
    return typeof data === "string" ? new Float32Array(bytes(data).buffer) : data;
  };

  /* ---- the page ---- */
  const badge = (kind, text) => Object.assign(document.createElement("span"), { className: `badge ${kind}`, textContent: text });
  const writeVerdicts = (verdicts) => {
    part(".verdict-line").replaceChildren(...verdicts.map((v) => Object.assign(badge(v.kind, `${v.name}: ${v.verdict}`), { title: v.detail })));
    const rows = document.querySelectorAll("#requirements tbody tr");
    verdicts.forEach((v, k) => {
      const row = rows[k];
      if (!row) return;
      const [, , detail, verdict] = row.cells, again = detail.querySelector(".seek");
      detail.textContent = `${v.detail} `;
      if (again && v.time !== null) { again.dataset.time = v.time; detail.append(again); }
      verdict.replaceChildren(badge(v.kind, v.verdict));
    });
  };
  const OF_FILE = "#numbers, #claims, #margins .tiles, .hero .chips";
  const mark = (changed) => {
    for (const each of document.querySelectorAll(OF_FILE)) each.classList.toggle("of-file", changed);
    const gone = original.scene && fixed.size ? " Arrows, plots or parts of the replay named so are those of the file." : "";
    part(".stale").hidden = !changed;
    part(".stale").textContent = `Replay with its phases, events and rules, plots, signals and requirements show the new run. Shapes, zones, limits, headline figures, claims and safety tiles are those of the file.${gone}`;
  };
  const present = (data, arrays) => {
    const { replay } = window.report, state = replay && replay.state();
    window.report.present(data, arrays);
    const now = window.report.replay;
    if (!state || !now) return;
    now.play(state.playing);
    if (state.frame) now.setFrame(state.frame);
    if (state.camera) now.choose(state.camera);
    now.seek(state.time);
  };

  let settle, busy = false, stop = false, wanted = null, shown = "";
  const pause = () => {
    let before = performance.now();
    return async (done) => {
      if (performance.now() - before < 16) return stop;
      part("progress").value = done / about.steps;
      await new Promise((go) => { const channel = new MessageChannel(); channel.port1.onmessage = go; channel.port2.postMessage(0); });
      await new Promise((go) => setTimeout(go, 0));
      before = performance.now();
      return stop;
    };
  };
  const outcome = (flight, seconds) => {
    const span = `${Judge.g(flight.time.length ? flight.time.at(-1) - about.start : 0)} s`;
    if (flight.cancelled) return `cancelled after ${span}`;
    if (!flight.rows) return `refused: ${flight.message}`;
    const took = `${span} in ${seconds.toFixed(2)} s`;
    return flight.complete ? `Run complete: ${took}.` : `The run ended early, ${took}: ${flight.message}`;
  };
  const compared = async (flight) => {
    if (!globalThis.crypto || !crypto.subtle) return "The bits cannot be compared: this browser computes no sha256 here.";
    const found = await Flight.sha256(flight.values);
    part(".bits").dataset.sha256 = found;
    return found === about.sha256 ? `Bits of this page = bits of the file: sha256 ${found} of ${flight.rows} rows of ${system.width} values.`
      : `The bits of this page are NOT those of the file: sha256 ${found} instead of ${about.sha256}.`;
  };

  const once = async (settings) => {
    stop = false;
    for (const name of ["progress", ".cancel"]) part(name).hidden = false;
    part("progress").value = 0;
    say("running");
    const began = performance.now(), flight = await system.fly(valuesOf(settings), pause());
    const seconds = (performance.now() - began) / 1000, constants = constantsOf(settings), same = unchanged(settings);
    for (const name of ["progress", ".cancel"]) part(name).hidden = true;
    if (flight.cancelled) return say(outcome(flight, seconds));
    const verdicts = verdictsOf(flight, constants);
    writeVerdicts(verdicts);
    part(".bits").textContent = same ? await compared(flight) : "";
    mark(!same);
    const key = JSON.stringify(settings);
    if (flight.rows > 1 && key !== (shown || JSON.stringify(sliders.map((s) => s.base)))) {
      const arrays = same ? stored : arraysOf(flight, constants);
      present(same ? original : dataOf(flight, constants, arrays, verdicts), arrays);
    }
    shown = key;
    say(outcome(flight, seconds));
    Object.assign(window.report.live, { flight: { rows: flight.rows, complete: flight.complete, message: flight.message, seconds }, verdicts, settings });
    return null;
  };
  const fly = async (settings) => {
    wanted = settings;
    if (busy) { stop = true; return settle; }
    busy = true;
    settle = (async () => {
      try {
        while (wanted) {
          const next = wanted;
          wanted = null;
          await once(next);
        }
      } catch (error) {
        say(`The page failed: ${error.message}`);
        throw error;
      } finally { busy = false; }
    })();
    return settle;
  };

  for (const slider of sliders) {
    show(slider);
    const steps = Number(slider.range.max);
    const moved = () => put(slider, slider.low + (slider.range.value / steps) * (slider.high - slider.low));
    slider.range.addEventListener("input", moved);
    slider.range.addEventListener("change", () => { moved(); fly(settingsNow()); });
    slider.exact.addEventListener("change", () => {
      if (slider.exact.value === "" || !Number.isFinite(Number(slider.exact.value))) return show(slider);
      put(slider, Number(slider.exact.value));
      return fly(settingsNow());
    });
  }
  part(".sliders").addEventListener("submit", (event) => event.preventDefault());
  part(".reset").addEventListener("click", () => { for (const s of sliders) put(s, s.base); fly(settingsNow()); });
  part(".compare").addEventListener("click", () => { for (const s of sliders) put(s, s.base); fly(settingsNow()); });
  part(".cancel").addEventListener("click", () => { stop = true; wanted = null; });

  const started = () => {
    const set = (settings) => { sliders.forEach((s, k) => put(s, settings[k])); return fly(settingsNow()); };
    window.report.live = { fly: set, idle: () => settle, sliders: sliders.map(({ low, high, base }) => ({ low, high, base })), arraysOf, ready: false };
    const small = system.rows * system.width * 8 < 64e6;
    say(small ? "" : "Compare bits, or move a slider: the run takes some seconds.");
    (small ? fly(settingsNow()) : Promise.resolve()).finally(() => { window.report.live.ready = true; });
  };
  if (window.report.ready) started();
  else document.addEventListener("ready", started);
})();
