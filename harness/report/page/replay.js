/* The replay in space. Data are in N axes about the origin of the scene; all that is drawn hangs in
 * one group, which for the Hill frame is turned by the inverse of that frame's attitude. three.js
 * draws. startReplay() can be called again with another scene once the one before is disposed of. */
"use strict";
function startReplay(scene, array, T, coasts) {
  const former = document.querySelector(".stage");
  startReplay.blank ||= former.cloneNode(true);
  const stage = startReplay.blank.cloneNode(true), canvas = stage.querySelector("canvas");
  former.replaceWith(stage);
  const ears = new AbortController();
  let renderer;
  try {
    renderer = new T.WebGLRenderer({ canvas, antialias: true, alpha: true, logarithmicDepthBuffer: true });
  } catch (error) {
    stage.replaceChildren(Object.assign(document.createElement("p"),
      { className: "failed", textContent: "The replay needs WebGL, which this browser does not offer." }));
    return null;
  }
  renderer.outputColorSpace = T.LinearSRGBColorSpace;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));

  /* what all parts of the replay share */
  const view = {
    T, scene, array, coasts, stage, canvas, part: (name) => stage.querySelector(name),
    listen: (object, name, act) => object.addEventListener(name, act, { signal: ears.signal }),
    space: new T.Scene(), root: new T.Group(), hill: new T.Group(),
    camera: new T.PerspectiveCamera(FIELD, 1, 0.02, 1e9),
    shapes: makeShapes(T), history: historyOf(array(scene.time), T),
    frame: scene.frames[0], hidden: new Set(), trueSize: false, scaleText: "", dirty: true, update, render,
  };
  view.now = view.history.first;
  view.space.add(view.root);
  view.root.add(view.hill);
  view.labels = makeLabels(view);
  view.sky = makeSky(view);
  const bodies = makeBodies(view);
  const marks = view.marks = makeMarks(view, bodies);
  view.timeline = makeTimeline(view);
  view.story = makeStory(view);
  const cameras = makeCameras(view, bodies), { timeline, story, labels, sky } = view;
  const recorder = makeRecorder(view);
  sky.addRings(Math.max(...scene.frames.map((f) => cameras.bounds[f.key].radius * 1.3)));
  const centre = bodies.named[scene.centre];

  /* ---- one instant ---- */
  const turn = new T.Quaternion();
  function update(once) {
    const at = view.history.place(view.now);
    if (scene.hill) view.history.quaternion(array(scene.hill), at, view.hill.quaternion);
    view.root.quaternion.copy(view.frame.key === "H" ? turn.copy(view.hill.quaternion).conjugate() : turn.identity());
    bodies.place(at);
    if (centre) view.hill.position.copy(centre.group.position);
    marks.place(at);
    sky.place(at);
    view.root.updateMatrixWorld(true);
    cameras.set(once);
    view.camera.updateMatrixWorld();
    resize();
    timeline.show();
    story.show(at);
    view.dirty = true;
    document.dispatchEvent(new CustomEvent("replay", { detail: view.now }));
  }
  function resize() {
    const height = canvas.clientHeight || 1;
    const largest = bodies.resize(view.camera, height);
    marks.resize(view.camera, height);
    view.scaleText = largest > 1.05 ? `bodies drawn ${largest.toPrecision(2)} times as large` : "";
  }
  function render() {
    view.camera.updateMatrixWorld();
    sky.shine(view.camera);
    renderer.render(view.space, view.camera);
    labels.draw(view.camera);
  }

  /* ---- frames, what is shown ---- */
  function setFrame(name) {
    view.frame = scene.frames.find((f) => f.key === name) || view.frame;
    for (const button of view.part(".frames").children) button.setAttribute("aria-pressed", button.dataset.frame === view.frame.key);
    cameras.renew();
    update();
    cameras.choose(cameras.chosen || "overview");
  }
  view.part(".frames").replaceChildren(...scene.frames.map((f) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: f.key, title: f.name });
    button.dataset.frame = f.key;
    button.addEventListener("click", () => setFrame(f.key));
    return button;
  }));

  const CHOICES = { axes: "body axes", marks: "zones and axes", plumes: "plumes", trails: "paths", planet: "planet and Sun", rings: "rings of range" };
  function choice(name, text, on, act) {
    const line = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", checked: on });
    box.name = name;
    box.addEventListener("change", () => { act(box.checked); update(); });
    line.append(box, ` ${text}`);
    return line;
  }
  const there = { axes: true, trails: true, rings: true, marks: marks.list.length, plumes: bodies.plumes.length, planet: sky.planet };
  view.part(".shown div").replaceChildren(
    ...Object.entries(CHOICES).filter(([name]) => there[name]).map(([name, text]) =>
      choice(name, text, true, (on) => (on ? view.hidden.delete(name) : view.hidden.add(name)))),
    choice("size", "true size", false, (on) => { view.trueSize = on; }));

  /* ---- size, keys, frames of the screen ---- */
  function fitCanvas() {
    const width = stage.clientWidth, height = stage.clientHeight;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    view.camera.aspect = width / height;
    view.camera.updateProjectionMatrix();
    update(true);
  }
  const full = () => (document.fullscreenElement ? document.exitFullscreen() : stage.requestFullscreen());
  const keys = { ...timeline.keys, c: cameras.next, f: full,
    h: () => setFrame(scene.frames[(scene.frames.indexOf(view.frame) + 1) % scene.frames.length].key) };
  view.listen(stage, "keydown", (event) => {
    const inside = /^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(event.target.tagName);
    if (!keys[event.key] || event.ctrlKey || event.metaKey || (inside && /^( |Arrow.*|Page.*|Home|End)$/.test(event.key))) return;
    keys[event.key]();
    event.preventDefault();
  });
  view.listen(view.part(".full"), "click", full);
  canvas.tabIndex = 0;

  let before = 0, visible = true, ended = false;
  function beat(stamp) {
    if (ended) return;
    requestAnimationFrame(beat);
    if (!visible && !recorder.recording) { before = 0; return; }
    const passed = before ? Math.min(0.1, (stamp - before) / 1000) : 0;
    before = stamp;
    timeline.advance(passed);
    cameras.move();
    if (!view.dirty) return;
    view.dirty = false;
    if (!timeline.playing) resize();
    render();
    recorder.after();
  }
  const sized = new ResizeObserver(fitCanvas), seen = new IntersectionObserver(([entry]) => { visible = entry.isIntersecting; });
  setFrame(view.frame.key);
  sized.observe(stage);
  seen.observe(stage);
  fitCanvas();
  requestAnimationFrame(beat);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!timeline.follow() && !still) timeline.play(true);
  recorder.print();

  /* what the picture shows, for tests and for other programs */
  const state = () => ({
    time: view.now, playing: timeline.playing, frame: view.frame.key, camera: cameras.chosen, speed: timeline.speed,
    eye: view.camera.position.toArray(), first: cameras.first(), phase: story.phase(), dark: sky.dark,
    sun: scene.sun ? sky.towards.toArray() : null, recording: recorder.recording,
    width: canvas.clientWidth, height: canvas.clientHeight,
    rules: Object.fromEntries(story.rules.map((rule) => [rule.name, rule.now])),
    marks: marks.list.map((mark) => ({ text: mark.text, kind: mark.kind, now: mark.now,
      position: mark.made.getWorldPosition(new T.Vector3()).toArray(), size: mark.made.getWorldScale(new T.Vector3()).toArray() })),
    bodies: Object.fromEntries(bodies.list.map((b) => [b.name, {
      position: bodies.world(b).toArray(), attitude: b.group.getWorldQuaternion(new T.Quaternion()).toArray(),
      screen: labels.onScreen(b.group, view.camera), scale: b.shape.scale.x, shown: b.shape.visible,
      joints: b.links.map((l) => l.joint.quaternion.toArray()),
      places: b.links.map((l) => l.joint.position.toArray()) }])),
    plumes: bodies.plumes.filter((each) => each.made.visible).length,
  });
  function dispose() {
    ended = true;
    ears.abort();
    sized.disconnect();
    seen.disconnect();
    timeline.dispose();
    cameras.dispose();
    view.space.traverse((o) => { o.geometry?.dispose(); for (const m of [o.material].flat()) m?.dispose(); });
    renderer.dispose();
    renderer.forceContextLoss();
  }
  return { seek: timeline.seek, play: timeline.play, setFrame, choose: cameras.choose, state, dispose,
    step: timeline.step, compose: recorder.compose, speed: (value) => { timeline.speed = value; } };
}
