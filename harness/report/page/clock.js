/* Control of the time of a replay: slider with phases and events, speeds, steps and keys. The
 * address of the page contains the instant that is shown, so that a link can refer to it. */
"use strict";
const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
const WHOLE = 30;   /* playing time at the speed `whole run` [s] */

function makeClock(view) {
  const { scene, history, part } = view;
  const { first, last, span } = history, scrub = part(".scrub"), select = part(".speed");
  const share = (t) => (t - first) / (span || 1);
  const events = (scene.events || []).filter((e) => e.time >= first && e.time <= last);
  let playing = false, addressed = null;

  const fitted = span / WHOLE || 1;
  const speeds = SPEEDS.filter((s) => span / s > 3 && span / s < 4000);
  select.replaceChildren(new Option(`whole run in ${WHOLE} s`, fitted, true, true), ...speeds.map((s) => new Option(`${s}×`, s)));

  /* ---- phases and events on the slider ---- */
  const percent = (t) => `${100 * share(t)}%`;
  const phases = scene.phases || [], runs = [...new Set(phases.map((each) => each.run || ""))];
  part(".phases").replaceChildren(...runs.flatMap((run, place) => phases.filter((each) => (each.run || "") === run).map((phase, k) => {
    const made = Object.assign(document.createElement("i"), { className: k % 2 ? "odd" : "even",
      title: `${run ? `${run}: ` : ""}${phase.text}: ${phase.begin.toFixed(1)} to ${phase.end.toFixed(1)} s` });
    made.style.left = percent(phase.begin);
    made.style.width = `${100 * (share(phase.end) - share(phase.begin))}%`;
    made.style.top = `${(100 * place) / runs.length}%`;
    made.style.height = `${100 / runs.length}%`;
    return made;
  })));
  part(".events").replaceChildren(...events.map((event) => {
    const made = Object.assign(document.createElement("button"), { type: "button", className: `event ${event.kind || "plain"}`,
      title: `${clock(event.time)} s: ${event.text}`, ariaLabel: `${clock(event.time)} s: ${event.text}` });
    made.style.left = percent(event.time);
    made.dataset.time = event.time;
    made.addEventListener("click", () => { play(false); seek(event.time); });
    return made;
  }));
  function clock(t) { return t.toFixed(span > 500 ? 0 : span > 5 ? 1 : 3); }

  /* ---- playing, stepping, seeking ---- */
  function seek(t) {
    view.now = Math.min(last, Math.max(first, t));
    view.update();
    if (!playing) address();
  }
  function play(on) {
    if (on && !playing && view.now >= last) view.now = first;
    playing = on;
    part(".play").textContent = on ? "\u275A\u275A" : "\u25B6";
    part(".play").setAttribute("aria-pressed", on);
    view.update();
    if (!on) address();
  }
  const step = (count) => { play(false); seek(history.step(view.now, count)); };
  function event(direction) {
    const later = events.filter((e) => direction * (e.time - view.now) > 1e-6 * (span || 1));
    const found = direction > 0 ? later[0] : later[later.length - 1];
    play(false);
    seek(found ? found.time : direction > 0 ? last : first);
  }
  function advance(seconds) {
    if (!playing) return;
    view.now = Math.min(last, view.now + seconds * select.value);
    if (view.now >= last) play(false); else view.update();
  }

  /* ---- the address: #t=1547 ---- */
  function address() {
    clearTimeout(addressed);
    addressed = setTimeout(() => window.history.replaceState(null, "", `#t=${+view.now.toPrecision(8)}`), 150);
  }
  function follow() {
    const found = /^#t=(-?[\d.]+(?:e-?\d+)?)$/i.exec(window.location.hash);
    if (found) { play(false); seek(Number(found[1])); }
    return !!found;
  }

  function show() {
    part(".clock").value = `${clock(view.now)} / ${clock(last)} s`;
    if (document.activeElement !== scrub || playing) scrub.value = share(view.now);
    scrub.setAttribute("aria-valuetext", `${clock(view.now)} s`);
  }

  const KEYS = {
    " ": () => play(!playing), ArrowRight: () => seek(view.now + 0.01 * span), ArrowLeft: () => seek(view.now - 0.01 * span),
    ".": () => step(1), ",": () => step(-1), PageDown: () => event(1), PageUp: () => event(-1),
    Home: () => seek(first), End: () => seek(last),
  };

  view.listen(part(".play"), "click", () => play(!playing));
  view.listen(scrub, "input", () => seek(first + Number(scrub.value) * span));
  view.listen(part(".back"), "click", () => step(-1));
  view.listen(part(".ahead"), "click", () => step(1));
  view.listen(part(".earlier"), "click", () => event(-1));
  view.listen(part(".later"), "click", () => event(1));
  view.listen(window, "hashchange", follow);

  return { events, seek, play, step, event, advance, show, follow, format: clock, keys: KEYS,
    get playing() { return playing; }, get speed() { return Number(select.value); },
    set speed(value) {
      if (![...select.options].some((o) => Number(o.value) === value)) select.append(new Option(`${+value.toPrecision(3)}×`, value));
      select.value = String(value);
    },
    dispose() { clearTimeout(addressed); } };
}
