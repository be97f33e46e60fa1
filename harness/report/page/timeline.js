/* Texts over the replay: title, present phase, values, and states of the safety rules. */
"use strict";
function makeTimeline(view) {
  const { scene, array, history, part } = view;
  const node = (tag, cls, text) => Object.assign(document.createElement(tag), { className: cls, textContent: text });
  const unit = (value, name) => (Math.abs(value) >= 1000 && name === "m" ? `${(value / 1000).toPrecision(4)} km`
    : `${value.toPrecision(4)} ${name === "1" ? "" : name}`);
  const phases = scene.phases || [], events = scene.events || [];

  const rules = (scene.rules || []).map((rule) => {
    const made = node("button", "rule", "");
    made.type = "button";
    made.title = rule.title;
    made.append(node("i", "", ""), node("span", "", rule.name), node("b", "", ""));
    view.listen(made, "click", () => { if (rule.violated !== null) { view.clock.play(false); view.clock.seek(rule.violated); } });
    return { ...rule, made, margins: rule.margin && array(rule.margin), which: rule.which && array(rule.which), states: array(rule.state) };
  });
  part(".rules").replaceChildren(...rules.map((rule) => rule.made));
  part(".title").textContent = scene.title || "";
  part(".title").title = scene.about || "";

  function showRules(at) {
    for (const rule of rules) {
      const state = history.state(rule.states, at);
      const late = rule.violated !== null && view.now >= rule.violated;
      rule.now = state === VIOLATED ? "violated" : late ? "was" : state === RESTS ? "rests" : "holds";
      rule.made.className = `rule ${rule.now}`;
      const now = rule.words ? (state === VIOLATED ? rule.words[history.state(rule.which, at)] : "all rules hold")
        : unit(history.state(rule.margins, at), rule.unit);
      rule.made.children[2].textContent = state === RESTS ? (rule.words ? "no rule applies" : "does not apply")
        : `${state === VIOLATED ? "violated, " : ""}${now}${rule.now === "was" ? `, violated at ${view.clock.format(rule.violated)} s` : ""}`;
    }
  }

  /* lines of values in the corner of the picture, as [value, name] */
  function lines(at) {
    const found = [];
    if (scene.range) found.push([unit(history.scalar(array(scene.range), at), "m"), "range"]);
    if (scene.speed) found.push([unit(history.scalar(array(scene.speed), at), "m/s"), "relative speed"]);
    for (const extra of scene.numbers || [])
      found.push(extra.words ? [extra.words[history.state(array(extra.values), at)], extra.name]
        : [unit(extra.factor * history.scalar(array(extra.values), at), extra.unit), named(extra.name)]);
    if (view.sky.dark > 0.5) found.push(["in the shadow of the Earth", ""]);
    return found;
  }
  /* text of the present phase; run: label in a replay of several runs */
  const phase = (run = "") => phases.filter((each) => (each.run || "") === run && each.begin <= view.now).pop()?.text || "";
  const named = (run) => [run, phase(run)].filter(Boolean).join(", ");
  const recent = () => events.filter((each) => each.time <= view.now).pop();

  function show(at) {
    part(".phase").textContent = phase();
    part(".numbers").replaceChildren(...lines(at).map(([value, name]) => {
      const line = node("span", "", "");
      line.append(node("b", "", value), name ? ` ${name}` : "");
      return line;
    }));
    const past = recent(), about = [`${view.frame.name}, origin: ${scene.origin}`];
    if (past) about.unshift(`${view.clock.format(past.time)} s: ${past.text}`);
    if (view.scaleText) about.push(view.scaleText);
    if (scene.undated) about.push(scene.undated);
    part(".about").replaceChildren(...about.map((text) => node("span", "", text)));
    showRules(at);
  }
  return { show, phase, rules, lines, recent };
}
