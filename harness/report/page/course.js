/* Phases, events and violations in the replay of a run that a live page has made, computed from the
 * arrays of this run. The names of phases, values and rules are taken from the scene in the page. */
"use strict";
const Course = (() => {
  const VIOLATED = 2, DARK = 0.5;

  /* indices of those values that differ from the previous value; index 0 is included */
  const changes = (values) => Array.from(values.keys()).filter((k) => k === 0 || values[k] !== values[k - 1]);

  function phasesOf(scene, array, times, end) {
    if (!scene.course) return (scene.phases || []).filter((each) => each.begin <= end).map((each) => ({ ...each, end: Math.min(each.end, end) }));
    const values = array(scene.course.values), begins = changes(values);
    return begins.map((k, i) => ({ begin: times[k], end: i + 1 < begins.length ? times[begins[i + 1]] : end, text: scene.course.words[values[k]] }));
  }

  /* a safety rule with the added entry `violated`: the first instant of the replay at which the
   * rule is violated [s], null if there is none */
  function ruleOf(rule, array, times) {
    const first = array(rule.state).indexOf(VIOLATED);
    return { ...rule, violated: first < 0 ? null : times[first] };
  }

  function* eventsOf(scene, array, times, end, verdicts) {
    const alarms = scene.course?.alarms || [];
    if (scene.course) for (const { begin, text } of phasesOf(scene, array, times, end)) yield [begin, text, alarms.includes(text) ? "abort" : "phase"];
    else for (const each of scene.events || []) if (each.kind === "phase") yield [each.time, each.text, each.kind];
    for (const each of (scene.numbers || []).filter((number) => number.words)) {
      const values = array(each.values);
      for (const k of changes(values).slice(1)) yield [times[k], `${each.name}: ${each.words[values[k]]}`, "capture"];
    }
    for (const rule of (scene.rules || []).map((each) => ruleOf(each, array, times)))
      if (rule.violated !== null) yield [rule.violated, `${rule.name}: violated for the first time`, "violation"];
    for (const { name, kind, verdict, detail, time } of verdicts)
      if (time !== null) yield [time, `${name}: ${kind === "bad" ? `${verdict}, ` : ""}${detail}`, kind === "bad" ? "violation" : "worst"];
    if (scene.sun && !scene.undated) {
      const dark = Array.from(array(scene.sun.shadow), (part) => part > DARK);
      for (const k of changes(dark).slice(1)) yield [times[k], `${dark[k] ? "into" : "out of"} the shadow (of the run in the file)`, "light"];
    }
    if (end < times[times.length - 1]) yield [end, "the run ends", "abort"];
  }

  /* the scene with the phases and events of a run; array(name): arrays of this run; end: its end
   * time [s] */
  function ofRun(scene, array, end, verdicts) {
    const times = array(scene.time);
    const events = [...eventsOf(scene, array, times, end, verdicts)].filter(([time]) => time <= end);
    return {
      ...scene, phases: phasesOf(scene, array, times, end), rules: (scene.rules || []).map((each) => ruleOf(each, array, times)),
      events: events.map(([time, text, kind]) => ({ time, text, kind })).sort((a, b) => a.time - b.time),
    };
  }
  return { ofRun };
})();
if (typeof module !== "undefined") module.exports = Course;
