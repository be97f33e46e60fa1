/* Names in the picture, with a line from each name of a body to the body, and the axes of the frame
 * in the corner. */
"use strict";
const SVG = "http://www.w3.org/2000/svg";
const svg = (tag, about = {}) => {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(about)) made.setAttribute(name, value);
  return made;
};

function makeLabels(view) {
  const { T, stage, canvas } = view;
  const place = view.part(".names"), leaders = svg("svg", { class: "leaders" }), list = [], p = new T.Vector3();
  place.replaceChildren(leaders);

  /* leader: with a line from afar; size: radius of what it names; near: distance of the eye up to
   * which it is shown; shown: whether it is */
  function add(text, object, colour, about = {}) {
    const made = Object.assign(document.createElement("div"), { className: "label", textContent: text });
    if (about.title) made.title = about.title;
    made.style.color = colour;
    place.append(made);
    const line = about.leader && svg("line", { stroke: colour });
    if (line) leaders.append(line);
    list.push({ made, line, object, colour, text, about, at: null });
  }

  /* where an object is in the picture [px]; null: behind the eye */
  function onScreen(object, camera) {
    object.getWorldPosition(p).project(camera);
    if (p.z >= 1) return null;
    return { x: ((p.x + 1) / 2) * canvas.clientWidth, y: ((1 - p.y) / 2) * canvas.clientHeight };
  }

  function draw(camera) {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    const words = view.part(".readout"), right = words.offsetLeft + words.offsetWidth, below = words.offsetTop + words.offsetHeight;
    const free = (each, at) => each.line || at.x > right || at.y > below;
    const seen = list.map((each) => {
      const at = each.about.shown && !each.about.shown() ? null : onScreen(each.object, camera);
      const far = each.about.near && each.object.getWorldPosition(p).distanceTo(camera.position) > each.about.near;
      return at && !far && at.x > 0 && at.x < width && at.y > 0 && at.y < height && free(each, at) ? at : null;
    });
    const led = seen.filter((at, k) => at && list[k].line);
    const middle = led.reduce((sum, at) => ({ x: sum.x + at.x / led.length, y: sum.y + at.y / led.length }), { x: 0, y: 0 });
    let order = 0;
    const taken = [], crowded = (at) => taken.some((other) => Math.abs(other.x - at.x) < 48 && Math.abs(other.y - at.y) < 15);
    list.forEach((each, k) => {
      const at = !seen[k] || each.line || !crowded(seen[k]) ? seen[k] : null;
      if (at && !each.line) taken.push(at);
      each.made.style.display = at ? "block" : "none";
      if (each.line) each.line.style.display = at ? "block" : "none";
      each.at = at && (each.line ? lead(each, at, middle, order++, camera) : at);
      if (each.at) each.made.style.transform = `translate(${each.at.x}px, ${each.at.y}px) translate(-50%, -50%)`;
    });
  }

  /* a name stands away from the others, beyond what it names */
  function lead(each, at, middle, order, camera) {
    let x = at.x - middle.x, y = at.y - middle.y, length = Math.hypot(x, y);
    if (length < 12) [x, y, length] = [Math.cos(2.4 * order - 1), Math.sin(2.4 * order - 1), 1];
    x /= length;
    y /= length;
    const distance = each.object.getWorldPosition(p).distanceTo(camera.position);
    const seen = each.about.size ? (each.about.size() / distance / Math.tan((camera.fov * Math.PI) / 360)) * canvas.clientHeight / 2 : 0;
    const far = Math.min(150, 34 + 0.75 * seen);
    const clamp = (value, edge, low, high) => Math.min(edge - high, Math.max(low, value));
    const end = { x: clamp(at.x + far * x, canvas.clientWidth, 50, 50), y: clamp(at.y + far * y, canvas.clientHeight, 24, 80) };
    Object.entries({ x1: at.x, y1: at.y, x2: end.x, y2: end.y }).forEach(([name, value]) => each.line.setAttribute(name, value));
    each.from = at;
    return end;
  }

  /* ---- the axes of the frame ---- */
  const triad = svg("svg", { viewBox: "-50 -50 100 100" });
  view.part(".triad").replaceChildren(triad);
  const limbs = [0, 1, 2].map((k) => {
    const colour = new T.Color(AXIS_COLOURS[k]).getHexString(T.LinearSRGBColorSpace);
    const line = svg("line", { stroke: `#${colour}`, "stroke-width": 2.4 });
    const text = svg("text", { fill: "#d6deea", "font-size": 10, "text-anchor": "middle" });
    triad.append(line, text);
    return { line, text };
  });
  function drawTriad(camera) {
    const turned = camera.quaternion.clone().conjugate();
    limbs.forEach(({ line, text }, k) => {
      const end = new T.Vector3().setComponent(k, 1).applyQuaternion(turned);
      line.setAttribute("x2", 28 * end.x);
      line.setAttribute("y2", -28 * end.y);
      text.setAttribute("x", 38 * end.x);
      text.setAttribute("y", -38 * end.y + 3);
      text.textContent = Math.hypot(end.x, end.y) > 0.4 ? view.frame.axes[k] : ""; /* else it points at the eye */
    });
  }

  return { add, list, onScreen, draw(camera) { draw(camera); drawTriad(camera); }, stage };
}
