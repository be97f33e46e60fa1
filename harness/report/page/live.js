/* Live page: after a slider has been moved, the system runs again, and plots, replay and
 * verdicts show the new rows. */
"use strict";
(async () => {
  const section = document.getElementById("live"), part = (name) => section.querySelector(name);
  const say = (text) => { part(".outcome").textContent = text; };
  const lacking = [["WebAssembly", typeof WebAssembly], ["DecompressionStream", typeof DecompressionStream]]
    .filter(([, type]) => type === "undefined").map(([name]) => name);
  if (lacking.length) {
    say(`This browser cannot run the system: it has no ${lacking.join(" and no ")}. The report shows the run in the file.`);
    section.classList.add("unable");
    for (const each of section.querySelectorAll("input, button")) each.disabled = true;
    return;
  }

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const about = JSON.parse(document.getElementById("simulation").textContent);
  const system = await Simulation.open(await Simulation.unpacked(bytes(document.getElementById("wasm").textContent)), about);
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
    slider.range.setAttribute("aria-valuetext", Program.g(slider.now));
    slider.exact.value = Number(slider.now.toPrecision(10));
    slider.box.classList.toggle("moved", slider.now !== slider.base);
  };
  const put = (slider, value) => {
    slider.now = Math.min(slider.high, Math.max(slider.low, value));
    show(slider);
  };

  /* ---- verdicts, curves and samples of a run ---- */
  const known = (list, name, kind) => list[name] || (() => { throw new Error(`there is no ${kind} ${name}`); })();
  /* time, variables and parameters of a run as tables for program.js, by lookUp(name) */
  const tablesOf = (time, values, constants, complete) => ({
    time, complete,
    lookUp: (name) => {
      if (name === "time") return Program.table(time.length, 1, time);
      if (name.startsWith("parameter ")) return Program.table(1, known(about.parameters, name.slice(10), "parameter")[1].length, Float64Array.from(about.parameters[name.slice(10)][1], (k) => constants[k]));
      const columns = known(about.names, name, "variable")[1], m = columns.length, found = Program.table(time.length, m);
      for (let k = 0; k < time.length; k++) for (let i = 0; i < m; i++) found.data[k * m + i] = values[k * system.width + columns[i]];
      return found;
    },
  });
  const verdictsOf = (wanted, result, constants) => {
    const tables = tablesOf(result.time, result.values, constants, result.complete), value = Program.evaluator(about.program, tables);
    return wanted.map((each) => ({ name: each.name, ...(result.rows ? Program.verdictOf(tables, value, each) : { kind: "none", verdict: "not judged", detail: "nothing was recorded", time: null }) }));
  };

  /* Data and arrays with which the page shows a new run. If the run ended early, the bodies remain
   * where they are in its last row. A curve without instructions still shows the run with which the
   * page was written, and its name states this. A marker is removed if its label contains a value
   * of that run. */
  const OF_FILE = "(of the run in the file)";
  const contentOf = (result, constants, verdicts) => {
    const all = system.rows, values = new Float64Array(all * system.width);
    values.set(result.values);
    const last = result.values.subarray((result.rows - 1) * system.width);
    for (let k = result.rows; k < all; k++) values.set(last, k * system.width);
    const time = Float64Array.from({ length: all }, (_, k) => system.timeOf(k)), end = time[result.rows - 1];
    const value = Program.evaluator(about.program, tablesOf(time, values, constants, result.complete));
    const arrays = { ...stored }, data = structuredClone(original), single = (shape, from) => ({ shape, data: Float32Array.from(from) });
    for (const [name, [history, over, rows]] of Object.entries(about.samples))
      arrays[name] = single(stored[name].shape, Program.sample(value(history), over, about.rows[rows]).data);
    const follow = (curve, timed) => {
      const { x, y, begin } = curve.source, from = time.findIndex((t) => t >= begin - 1e-9 * Math.max(1, Math.abs(begin)));
      const drawn = [x, y].map((k) => value(k).data.subarray(from, Math.max(result.rows, from + 1)));
      const rows = Simulation.drawnRows(...drawn, timed, about.points);
      [curve.x, curve.y] = drawn.map((axis, k) => {
        const name = `${curve.source.y}:${curve.source.x}:${from}:${k}`;
        arrays[name] = single([rows.length], rows.map((i) => axis[i]));
        return name;
      });
    };
    for (const figure of [...data.figures.flatMap((part) => part.figures), ...data.signals])
      for (const plot of figure.plots) {
        const following = plot.curves.filter((curve) => curve.source);
        for (const curve of following) follow(curve, plot.time);
        if (!following.length) plot.title = `${plot.title || figure.title} ${OF_FILE}`;
        else plot.curves = plot.curves.filter((curve) => curve.source || !curve.marker);
        for (const curve of following.length ? plot.curves : []) if (!curve.source) curve.name = `${curve.name} ${OF_FILE}`.trim();
      }
    for (const component of data.signals)
      for (const each of component.fixed) each.value = still(result, `${component.name}.${each.variable}`, each.value);
    if (data.scene) data.scene = Course.ofRun(data.scene, numbersOf(arrays), result.time.at(-1), verdicts);
    return [data, arrays];
  };
  const still = (result, name, before) => {
    const found = about.names[name];
    if (!found) return before;
    const texts = found[1].map((column) => {
      let low = Infinity, high = -Infinity;
      for (let k = 0; k < result.rows; k++) {
        const v = result.values[k * system.width + column];
        if (v < low) low = v;
        if (v > high) high = v;
      }
      return low === high ? Program.g(low) : `${Program.g(low)} to ${Program.g(high)}`;
    });
    return texts.length === 1 ? texts[0] : `[${texts.join(", ")}]`;
  };

  /* the numbers of an array: of the new run, or decoded from base64 in the page */
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
      detail.textContent = `${v.detail.replace(/^worst /, "")} `;
      if (again) {
        again.hidden = v.time === null;
        again.dataset.time = v.time;
        detail.append(again);
      }
      verdict.replaceChildren(badge(v.kind, v.verdict));
    });
  };
  /* an exercise that was solved once remains solved */
  const writeExercises = (solved) => document.querySelectorAll(".exercises .state").forEach((state, k) => {
    if (solved[k]) state.replaceChildren(badge("good", "solved"));
    else if (!state.hasChildNodes()) state.replaceChildren(badge("none", "not solved yet"));
  });
  /* headline values of a new run; a value without an instruction still shows the run with which the
   * page was written */
  const tiles = [...document.querySelectorAll("#numbers .tile")];
  const valuesOfRun = (result, constants) => {
    const value = Program.evaluator(about.program, tablesOf(result.time, result.values, constants, result.complete));
    return about.metrics.map((k) => {
      if (k === null) return null;
      try { return value(k).data[0]; } catch { return NaN; }
    });
  };
  const writeValues = (values, changed) => values.forEach((value, k) => {
    const tile = tiles[k];
    tile.classList.toggle("of-file", changed && value === null);
    if (value === null) return;
    const text = (tile.dataset.words.split(",")[value]) || Program.g(value, 4);
    tile.hidden = !Number.isFinite(value);
    tile.querySelector("b").firstChild.data = text;
    if (tile.dataset.about) tile.setAttribute("aria-label", `${tile.querySelector("span").textContent} ${text} ${tile.dataset.unit}: ${tile.dataset.about}`);
  });
  const OF_FILE_ALONE = "#parameters .scroll, #claims, #margins .tiles, .hero .ended, .hero .chips";
  const mark = (changed) => {
    for (const each of document.querySelectorAll(OF_FILE_ALONE)) each.classList.toggle("of-file", changed);
    part(".stale").hidden = !changed;
    part(".stale").textContent = `The new run is shown by plots, signals, requirements, headline values, and the replay including its phases, events and safety rules. The run in the file is still shown by shapes, zones, limits, shadows, claims, safety margins, the table of parameters, the head of the page, and each headline value, plot or curve with the note "of the run in the file".`;
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
  const outcome = (result, seconds) => {
    const span = `${Program.g(result.time.length ? result.time.at(-1) - about.start : 0)} s`;
    if (result.cancelled) return `cancelled after ${span} of the run`;
    if (!result.rows) return `rejected, the page still shows the run before: ${result.message}`;
    const took = `${span} simulated in ${seconds.toFixed(2)} s`;
    return result.complete ? `Run complete: ${took}.` : `The run ended early, ${took}: ${result.message}`;
  };
  const compared = async (result) => {
    if (!globalThis.crypto || !crypto.subtle) return "The bits cannot be compared: this browser offers no sha256 to a page from this address.";
    const found = await Simulation.sha256(result.values);
    part(".bits").dataset.sha256 = found;
    return found === about.sha256 ? `Bits of this page = bits of the file: sha256 ${found} of ${result.rows} rows of ${system.width} values.`
      : `The bits of this page DIFFER from the bits of the file: sha256 ${found} instead of ${about.sha256}.`;
  };

  const once = async (settings) => {
    stop = false;
    for (const name of ["progress", ".cancel"]) part(name).hidden = false;
    part("progress").value = 0;
    say("running");
    const began = performance.now(), result = await system.run(valuesOf(settings), pause());
    const seconds = (performance.now() - began) / 1000, constants = constantsOf(settings), same = unchanged(settings);
    for (const name of ["progress", ".cancel"]) part(name).hidden = true;
    if (result.cancelled || !result.rows) return say(outcome(result, seconds));
    const verdicts = verdictsOf(about.requirements, result, constants);
    const exercises = verdictsOf(about.exercises, result, constants).map((v) => v.kind === "good");
    const values = valuesOfRun(result, constants);
    writeVerdicts(verdicts);
    writeValues(values, !same);
    writeExercises(exercises);
    part(".bits").textContent = same ? await compared(result) : "";
    mark(!same);
    const key = JSON.stringify(settings);
    if (result.rows > 1 && key !== (shown || JSON.stringify(sliders.map((s) => s.base)))) {
      present(...(same ? [original, stored] : contentOf(result, constants, verdicts)));
    }
    shown = key;
    say(outcome(result, seconds));
    Object.assign(window.report.live, { result: { rows: result.rows, complete: result.complete, message: result.message, seconds }, verdicts, values, exercises, settings });
    return null;
  };
  const start = async (settings) => {
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
    slider.range.addEventListener("change", () => { moved(); start(settingsNow()); });
    slider.exact.addEventListener("change", () => {
      if (slider.exact.value === "" || !Number.isFinite(Number(slider.exact.value))) return show(slider);
      put(slider, Number(slider.exact.value));
      return start(settingsNow());
    });
  }
  part(".sliders").addEventListener("submit", (event) => event.preventDefault());
  part(".reset").addEventListener("click", () => { for (const s of sliders) put(s, s.base); start(settingsNow()); });
  part(".compare").addEventListener("click", () => { for (const s of sliders) put(s, s.base); start(settingsNow()); });
  part(".cancel").addEventListener("click", () => { stop = true; wanted = null; });

  const started = () => {
    const set = (settings) => { sliders.forEach((s, k) => put(s, settings[k])); return start(settingsNow()); };
    window.report.live = { run: set, idle: () => settle, sliders: sliders.map(({ low, high, base }) => ({ low, high, base })), ready: false };
    const small = system.rows * system.width * 8 < 64e6;
    say(small ? "" : "Move a slider, or compare bits, to run the system. A run takes some seconds.");
    (small ? start(settingsNow()) : Promise.resolve()).finally(() => { window.report.live.ready = true; });
  };
  if (window.report.ready) started();
  else document.addEventListener("ready", started);
})();
