/* Replay in space, drawn by three.js. Positions are relative to the origin of the scene, in axes
 * of frame N. All objects belong to one group; to show the Hill frame, the group is rotated by the
 * inverse attitude of this frame. After dispose(), startReplay() can be called with another
 * scene. */
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

  /* state that all parts of the replay share */
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
  const zones = view.zones = makeZones(view, bodies);
  view.clock = makeClock(view);
  view.timeline = makeTimeline(view);
  const cameras = makeCameras(view, bodies), { clock, timeline, labels, sky } = view;
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
    zones.place(at);
    sky.place(at);
    view.root.updateMatrixWorld(true);
    cameras.set(once);
    view.camera.updateMatrixWorld();
    resize();
    clock.show();
    timeline.show(at);
    view.dirty = true;
    document.dispatchEvent(new CustomEvent("replay", { detail: view.now }));
  }
  function resize() {
    const height = canvas.clientHeight || 1;
    const largest = bodies.resize(view.camera, height);
    zones.resize(view.camera, height);
    view.scaleText = largest > 1.05 ? `bodies drawn ${largest.toPrecision(2)} times as large` : "";
  }
  function render() {
    view.camera.updateMatrixWorld();
    sky.shine(view.camera);
    renderer.render(view.space, view.camera);
    labels.draw(view.camera);
  }

  /* ---- frames, visible objects ---- */
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

  const CHOICES = { axes: "body axes", zones: "zones and axes", plumes: "plumes", trails: "paths", plans: "planned path", planet: "planet and Sun", rings: "rings of distance" };
  function choice(name, text, on, act) {
    const line = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", checked: on });
    box.name = name;
    box.addEventListener("change", () => { act(box.checked); update(); });
    line.append(box, ` ${text}`);
    return line;
  }
  const there = { axes: true, trails: true, rings: true, zones: zones.list.length, plumes: bodies.plumes.length, plans: bodies.plans.length, planet: sky.planet };
  view.part(".shown div").replaceChildren(
    ...Object.entries(CHOICES).filter(([name]) => there[name]).map(([name, text]) =>
      choice(name, text, true, (on) => (on ? view.hidden.delete(name) : view.hidden.add(name)))),
    choice("size", "true size", false, (on) => { view.trueSize = on; }));

  /* ---- size of the picture, keys, repeated drawing ---- */
  function fitCanvas() {
    stage.style.setProperty("--cameras", `${view.part(".cameras").offsetHeight}px`);
    stage.style.setProperty("--controls", `${view.part(".controls").offsetHeight}px`);
    const width = stage.clientWidth, height = stage.clientHeight;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    view.camera.aspect = width / height;
    view.camera.updateProjectionMatrix();
    update(true);
  }
  const full = () => (document.fullscreenElement ? document.exitFullscreen() : stage.requestFullscreen());
  const keys = { ...clock.keys, c: cameras.next, f: full,
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
    clock.advance(passed);
    cameras.move();
    if (!view.dirty) return;
    view.dirty = false;
    if (!clock.playing) resize();
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
  if (!clock.follow() && !still) clock.play(true);
  recorder.print();

  /* present state of the replay, for tests and other programs */
  const state = () => ({
    time: view.now, playing: clock.playing, frame: view.frame.key, camera: cameras.chosen, speed: clock.speed,
    eye: view.camera.position.toArray(), first: cameras.first(), phase: timeline.phase(), dark: sky.dark,
    sun: scene.sun ? sky.towards.toArray() : null, recording: recorder.recording,
    width: canvas.clientWidth, height: canvas.clientHeight,
    rules: Object.fromEntries(timeline.rules.map((rule) => [rule.name, rule.now])),
    zones: zones.list.map((mark) => ({ text: mark.text, kind: mark.kind, now: mark.now,
      position: mark.made.getWorldPosition(new T.Vector3()).toArray(), size: mark.made.getWorldScale(new T.Vector3()).toArray() })),
    bodies: Object.fromEntries(bodies.list.map((b) => [b.name, {
      position: bodies.world(b).toArray(), attitude: b.group.getWorldQuaternion(new T.Quaternion()).toArray(),
      screen: labels.onScreen(b.group, view.camera), scale: b.shape.scale.x, shown: b.shape.visible,
      joints: b.links.map((l) => l.joint.quaternion.toArray()),
      places: b.links.map((l) => l.joint.position.toArray()) }])),
    plumes: bodies.plumes.filter((each) => each.made.visible).length,
    plans: bodies.plans.map(({ made, vertices }) => ({ shown: made.visible, colour: view.shapes.css(made.material.color),
      position: made.position.toArray(), points: [...vertices.array] })),
  });
  function dispose() {
    ended = true;
    ears.abort();
    sized.disconnect();
    seen.disconnect();
    clock.dispose();
    cameras.dispose();
    view.space.traverse((o) => { o.geometry?.dispose(); for (const m of [o.material].flat()) m?.dispose(); });
    renderer.dispose();
    renderer.forceContextLoss();
  }
  return { seek: clock.seek, play: clock.play, setFrame, choose: cameras.choose, state, dispose,
    step: clock.step, compose: recorder.compose, speed: (value) => { clock.speed = value; } };
}
