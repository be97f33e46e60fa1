/* Names in the picture, with a line from the name of a body to the body; and the axes of the frame,
 * in a corner of the picture. */
"use strict";
const TURNS = [0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2, 1.8, -1.8, Math.PI]; /* directions of the line from a name to its body [rad] */
const LENGTHS = [1, 0.5, 2, 4]; /* lengths of this line, as multiples of `far` in leads() */
const ABOUT = [".readout", ".cameras", ".key", ".controls", ".triad"]; /* parts that labels avoid */
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

  /* Adds a label to an object. leader: whether to draw a line from the label to the object; size:
   * function that returns the radius of the object; near: largest distance of the eye at which the
   * label is shown; shown: function that returns whether the label is to be shown at present. */
  function add(text, object, colour, about = {}) {
    const made = Object.assign(document.createElement("div"), { className: "label", textContent: text });
    if (about.title) made.title = about.title;
    made.style.color = colour;
    place.append(made);
    const line = about.leader && svg("line", { stroke: colour });
    if (line) leaders.append(line);
    list.push({ made, line, object, colour, text, about, at: null });
  }

  /* position of an object in the picture [px], null if it is behind the eye */
  function onScreen(object, camera) {
    object.getWorldPosition(p).project(camera);
    if (p.z >= 1) return null;
    return { x: ((p.x + 1) / 2) * canvas.clientWidth, y: ((1 - p.y) / 2) * canvas.clientHeight };
  }

  /* Names of bodies are placed first: each moves around its body until it overlaps neither another
   * name nor the texts and buttons over the picture. A name that still overlaps an earlier one, or
   * would be cut by the edge, is left out. */
  function draw(camera) {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    const seen = list.map((each) => {
      const at = each.about.shown && !each.about.shown() ? null : onScreen(each.object, camera);
      const far = each.about.near && each.object.getWorldPosition(p).distanceTo(camera.position) > each.about.near;
      return at && !far && at.x > 0 && at.x < width && at.y > 0 && at.y < height ? at : null;
    });
    const led = seen.filter((at, k) => at && list[k].line);
    const middle = led.reduce((sum, at) => ({ x: sum.x + at.x / led.length, y: sum.y + at.y / led.length }), { x: 0, y: 0 });
    const taken = ABOUT.map(view.part).filter((box) => box && box.offsetWidth).map((box) => {
      const half = { x: box.offsetWidth / 2, y: box.offsetHeight / 2 };
      return { x: box.offsetLeft + half.x, y: box.offsetTop + half.y, half };
    });
    const isFree = (at, own) => at.x > own.x && at.x < width - own.x && taken.every((other) =>
      Math.abs(other.x - at.x) > other.half.x + own.x || Math.abs(other.y - at.y) > other.half.y + own.y);
    let order = 0;
    for (const [each, at] of list.map((one, k) => [one, seen[k]]).sort(([a], [b]) => !a.line - !b.line)) {
      const own = { x: 4 + 3.6 * each.text.length, y: 9 };
      const ends = !at ? [] : each.line ? leads(each, at, middle, order++, camera) : [at];
      each.at = ends.find((end) => isFree(end, own)) || null;
      each.made.style.display = each.at ? "block" : "none";
      if (each.line) each.line.style.display = each.at ? "block" : "none";
      if (!each.at) continue;
      taken.push({ ...each.at, half: own });
      each.made.style.transform = `translate(${each.at.x}px, ${each.at.y}px) translate(-50%, -50%)`;
      if (!each.line) continue;
      each.from = at;
      Object.entries({ x1: at.x, y1: at.y, x2: each.at.x, y2: each.at.y }).forEach(([name, value]) => each.line.setAttribute(name, value));
    }
  }

  /* possible positions of a label, the best first: on the side of its object that is away from the
   * middle of all objects, then turned to either side */
  function leads(each, at, middle, order, camera) {
    const x = at.x - middle.x, y = at.y - middle.y, away = Math.hypot(x, y) < 12 ? 2.4 * order - 1 : Math.atan2(y, x);
    const distance = each.object.getWorldPosition(p).distanceTo(camera.position);
    const seen = each.about.size ? (each.about.size() / distance / Math.tan((camera.fov * Math.PI) / 360)) * canvas.clientHeight / 2 : 0;
    const far = Math.min(150, 34 + 0.75 * seen);
    const clamp = (value, edge, low, high) => Math.min(edge - high, Math.max(low, value));
    return LENGTHS.flatMap((length) => TURNS.map((turn) => ({
      x: clamp(at.x + length * far * Math.cos(away + turn), canvas.clientWidth, 50, 50),
      y: clamp(at.y + length * far * Math.sin(away + turn), canvas.clientHeight, 24, 80),
    })));
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
    const turned = camera.quaternion.clone().conjugate(), placed = [];
    limbs.forEach(({ line, text }, k) => {
      const end = new T.Vector3().setComponent(k, 1).applyQuaternion(turned);
      line.setAttribute("x2", 28 * end.x);
      line.setAttribute("y2", -28 * end.y);
      const name = view.frame.axes[k], half = 2.8 * name.length;
      const x = 38 * end.x, y = -38 * end.y + (Math.abs(end.x) > Math.abs(end.y) ? -5 : 3); /* above the line of the axis */
      const free = placed.every((other) => Math.abs(other.x - x) > other.half + half || Math.abs(other.y - y) > 11);
      text.setAttribute("x", x);
      text.setAttribute("y", y);
      text.textContent = free && Math.hypot(end.x, end.y) > 0.4 ? name : ""; /* none if the axis points at the eye */
      if (text.textContent) placed.push({ x, y, half });
    });
  }

  return { add, list, onScreen, draw(camera) { draw(camera); drawTriad(camera); }, stage };
}
