/* The replay in space. Data are in N axes about the origin of the scene; all that is drawn hangs in
 * one group, which for the Hill frame is turned by the inverse of that frame's attitude. three.js
 * draws. */
"use strict";
function startReplay(scene, array, T) {
  const former = document.querySelector(".stage");
  startReplay.blank ||= former.cloneNode(true);
  const stage = startReplay.blank.cloneNode(true), canvas = stage.querySelector("canvas");
  former.replaceWith(stage);
  const part = (name) => stage.querySelector(name);
  const COLOURS = [0x56b4e9, 0xe69f00, 0x00b587, 0xcc79a7, 0xf0e442, 0x3d8fd1, 0xff7f3f, 0xd0d6e0];
  const AXES = [0xd55e00, 0x009e73, 0x4aa3ff];
  const tint = (which) => COLOURS[which % COLOURS.length];
  const times = array(scene.time), first = times[0], last = times[times.length - 1];

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

  const space = new T.Scene(), root = new T.Group(), hill = new T.Group();
  const camera = new T.PerspectiveCamera(38, 1, 0.02, 1e9);
  space.add(root);
  root.add(hill);
  space.add(new T.HemisphereLight(0xdfe9ff, 0x2a3040, 1.5));
  const sun = new T.DirectionalLight(0xffffff, 2.1);
  space.add(sun);

  /* ---- numbers between the instants ---- */
  const place = (t) => {
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const span = times[high] - times[low];
    return { low, high, part: span > 0 ? Math.min(1, Math.max(0, (t - times[low]) / span)) : 0 };
  };
  const scalar = (values, at) => values[at.low] + at.part * (values[at.high] - values[at.low]);
  const vector = (values, at, out) => {
    const a = 3 * at.low, b = 3 * at.high;
    return out.set(...[0, 1, 2].map((k) => values[a + k] + at.part * (values[b + k] - values[a + k])));
  };
  const quaternionAt = (values, k, out) =>
    out.set(values[4 * k + 1], values[4 * k + 2], values[4 * k + 3], values[4 * k]).normalize();
  const other = new T.Quaternion();
  const quaternion = (values, at, out) =>
    quaternionAt(values, at.low, out).slerp(quaternionAt(values, at.high, other), at.part);

  /* ---- parts of bodies ---- */
  const solid = (colour, about = {}) =>
    new T.MeshStandardMaterial({ color: colour, roughness: 0.6, metalness: 0.12, ...about });
  const glow = (colour, opacity) => new T.MeshBasicMaterial({
    color: colour, transparent: true, opacity, depthWrite: false, side: T.DoubleSide });
  const looks = ({ name, colour }) => ({
    hull: solid(name === "target" ? 0xc9a45a : 0xd9dee7), panel: solid(0x1b3a86, { roughness: 0.35, metalness: 0.3 }),
    metal: solid(0x8d97a6, { metalness: 0.4 }), arm: solid(0xf2f4f8), accent: solid(tint(colour)),
    second: solid(0xa9b7c6), fluid: solid(0x4fb3ff), tank: glow(0x9cc8ff, 0.16),
    shell: solid(0xd9dee7, { transparent: true, opacity: 0.35, depthWrite: false }),
  });
  const outline = (geometry, colour) =>
    new T.LineSegments(new T.EdgesGeometry(geometry), new T.LineBasicMaterial({ color: colour, transparent: true, opacity: 0.55 }));
  const up = new T.Vector3(0, 1, 0);
  const along = (object, direction) => {
    object.quaternion.setFromUnitVectors(up, new T.Vector3(...direction).normalize());
    return object;
  };
  /* lines of cells on both sides of a flat box */
  const cells = (size) => {
    const flat = size.indexOf(Math.min(...size)), [i, j] = [0, 1, 2].filter((k) => k !== flat);
    const points = [], cell = Math.max(size[i], size[j]) / 8;
    for (const [a, b] of [[i, j], [j, i]]) {
      const n = Math.max(1, Math.round(size[a] / cell));
      for (let k = 1; k < n; k++)
        for (const side of [-0.52, 0.52])
          for (const end of [-0.5, 0.5]) {
            const p = [0, 0, 0];
            p[a] = size[a] * (k / n - 0.5); p[b] = size[b] * end; p[flat] = size[flat] * side;
            points.push(new T.Vector3(...p));
          }
    }
    return new T.LineSegments(new T.BufferGeometry().setFromPoints(points),
      new T.LineBasicMaterial({ color: 0x8fb4ff, transparent: true, opacity: 0.45 }));
  };
  const SHAPES = {
    box(p, look) {
      const geometry = new T.BoxGeometry(...p.size), made = new T.Mesh(geometry, look[p.look]);
      made.add(p.look === "panel" ? cells(p.size) : outline(geometry, 0x10151f));
      made.position.set(...p.at);
      return made;
    },
    rod(p, look) {
      const a = new T.Vector3(...p.from), b = new T.Vector3(...p.to), d = b.clone().sub(a);
      const made = new T.Mesh(new T.CylinderGeometry(p.radius, p.radius, d.length(), 16), look[p.look]);
      made.position.copy(a.add(b).multiplyScalar(0.5));
      return along(made, d.toArray());
    },
    ball(p, look) {
      const made = new T.Mesh(new T.SphereGeometry(p.radius, 20, 14), look[p.look]);
      made.position.set(...p.at);
      return made;
    },
    nozzle(p, look) {
      const made = new T.Mesh(new T.CylinderGeometry(0.9 * p.size, 0.35 * p.size, p.size, 14, 1, true),
        Object.assign(look.metal.clone(), { side: T.DoubleSide }));
      made.position.set(...p.at);
      return along(made, p.out);
    },
    cup(p, look) {
      const a = new T.Vector3(...p.from), b = new T.Vector3(...p.to), d = b.clone().sub(a);
      const made = new T.Mesh(new T.CylinderGeometry(p.radii[1], p.radii[0], d.length(), 24, 1, true),
        Object.assign(look.metal.clone(), { side: T.DoubleSide }));
      made.position.copy(a.add(b).multiplyScalar(0.5));
      return along(made, d.toArray());
    },
    ring(p, look) {
      const made = new T.Group(), hoop = new T.Mesh(new T.TorusGeometry(p.radius, 0.14 * p.radius, 10, 40), look.accent);
      hoop.rotateX(Math.PI / 2);
      made.add(hoop);
      made.position.set(...p.at);
      return along(made, p.axis);
    },
    panel(p, look) {
      const size = [p.edge, 0.02 * p.edge, p.edge];
      const made = new T.Mesh(new T.BoxGeometry(...size), look.panel);
      made.add(cells(size));
      made.position.set(...p.at);
      return along(made, p.normal);
    },
  };
  const fill = (group, parts, look) => { for (const p of parts) group.add(SHAPES[p.kind](p, look)); };

  const arrow = (axis, length, colour) => {
    const made = new T.ArrowHelper(new T.Vector3().setComponent(axis, 1), new T.Vector3(), length, colour, 0.16 * length, 0.08 * length);
    made.traverse((o) => { if (o.material) o.material.depthTest = false; o.renderOrder = 5; });
    return made;
  };

  /* ---- labels ---- */
  const labels = [];
  const label = (text, object, colour, offset = 0) => {
    const made = Object.assign(document.createElement("div"), { className: "label", textContent: text });
    made.style.color = colour;
    stage.append(made);
    labels.push({ made, object, offset });
    return made;
  };
  const css = (colour) => `#${new T.Color(colour).getHexString(T.LinearSRGBColorSpace)}`;

  /* ---- bodies ---- */
  const shown = { bodies: [], axes: [], marks: [], trails: [], plumes: [], planet: [], rings: [] };
  const bodies = scene.bodies.map((data) => {
    const group = new T.Group(), shape = new T.Group(), look = looks(data);
    group.add(shape);
    root.add(group);
    fill(shape, data.parts, look);
    const links = data.links.map((link) => {
      const joint = new T.Group();
      fill(joint, link.parts, link.look ? { ...look, hull: look[link.look] } : look);
      return { ...link, joint, angle: link.angle && array(link.angle), slide: link.slide && array(link.slide),
        index: link.index || 0 };
    });
    links.forEach((link) => (link.on === undefined ? shape : links[link.on].joint).add(link.joint));
    for (const axis of [0, 1, 2]) {
      const made = arrow(axis, data.radius * 1.7, AXES[axis]);
      shape.add(made);
      shown.axes.push(made);
    }
    const text = label(data.name, group, css(tint(data.colour)), 1);
    const r = array(data.r), q = array(data.q);
    return { ...data, group, shape, links, r, q, text, hilly: inHill(r), trails: [] };
  });

  function inHill(r) {
    if (!scene.hill) return r;
    const q = array(scene.hill), turn = new T.Quaternion(), p = new T.Vector3(), out = new Float32Array(r.length);
    for (let k = 0; k < r.length / 3; k++) {
      p.set(r[3 * k], r[3 * k + 1], r[3 * k + 2]).applyQuaternion(quaternionAt(q, k, turn).conjugate());
      p.toArray(out, 3 * k);
    }
    return out;
  }

  for (const body of bodies.filter((b) => b.trail))
    for (const key of scene.frames.map((f) => f.key)) {
      const points = new T.BufferAttribute(key === "H" ? body.hilly : body.r, 3);
      const lines = [[0.28, 0x9fb3c8], [1, tint(body.colour)]].map(([opacity, colour]) => {
        const geometry = new T.BufferGeometry().setAttribute("position", points);
        const line = new T.Line(geometry, new T.LineBasicMaterial({ color: colour, transparent: true, opacity }));
        line.frustumCulled = false;
        (key === "H" ? space : root).add(line);
        return line;
      });
      body.trails.push({ key, lines });
    }

  /* ---- marks ---- */
  const byName = Object.fromEntries(bodies.map((b) => [b.name, b]));
  const carrier = (name) => (name === "H" ? hill : name === "N" ? root : byName[name].group);
  const moving = [], key = part(".key");
  const MARKS = {
    ellipsoid(m) { const o = zone(new T.SphereGeometry(1, 24, 16), 0xff8a5c); o.scale.set(...m.half); return o; },
    cuboid(m) { const o = zone(new T.BoxGeometry(2, 2, 2), 0xff8a5c); o.scale.set(...m.half); return o; },
    cone(m) {
      const made = new T.Group(), wide = m.length * Math.tan(m.angle);
      const cone = zone(new T.ConeGeometry(wide, m.length, 24, 5, true), 0x00b587);
      cone.position.y = m.length / 2;
      cone.rotation.x = Math.PI;
      made.add(cone);
      made.position.set(...m.at);
      return along(made, m.axis);
    },
    axis(m) {
      const end = new T.Vector3(...m.axis).multiplyScalar(m.length);
      const line = new T.Line(new T.BufferGeometry().setFromPoints([new T.Vector3(), end]),
        new T.LineDashedMaterial({ color: 0xf0e442, dashSize: m.length / 60, gapSize: m.length / 90 }));
      line.computeLineDistances();
      return line;
    },
    point(m) {
      const made = new T.Mesh(new T.OctahedronGeometry(1), glow(0xcc79a7, 0.95));
      moving.push({ made, r: array(m.r) });
      return made;
    },
  };
  const MARK_COLOURS = { ellipsoid: 0xff8a5c, cuboid: 0xff8a5c, cone: 0x00b587, axis: 0xf0e442, point: 0xcc79a7 };
  function zone(geometry, colour) {
    const made = new T.Mesh(geometry, glow(colour, 0.07));
    const net = new T.LineSegments(new T.EdgesGeometry(geometry, 1),
      new T.LineBasicMaterial({ color: colour, transparent: true, opacity: 0.16, depthWrite: false }));
    made.add(net);
    return made;
  }
  for (const m of scene.marks || []) {
    const made = MARKS[m.kind](m);
    carrier(m.on).add(made);
    shown.marks.push(made);
    const line = document.createElement("div"), swatch = document.createElement("i");
    swatch.style.borderColor = css(MARK_COLOURS[m.kind]);
    line.append(m.text, swatch);
    key.append(line);
  }

  /* ---- plumes: cones that fade out, as long as the command is large ---- */
  const plumes = (scene.plumes || []).map((data) => {
    const body = byName[data.body], geometry = new T.CylinderGeometry(0.22, 0.03, 1, 18, 8, true);
    geometry.translate(0, 0.5, 0);
    const y = geometry.attributes.position, fade = new Float32Array(3 * y.count);
    for (let k = 0; k < y.count; k++) fade.fill((1 - y.getY(k)) ** 1.6, 3 * k, 3 * k + 3);
    geometry.setAttribute("color", new T.BufferAttribute(fade, 3));
    const made = new T.Mesh(geometry, new T.MeshBasicMaterial({ color: 0x9fd8ff, vertexColors: true,
      transparent: true, blending: T.AdditiveBlending, depthWrite: false, side: T.DoubleSide }));
    made.position.set(...data.at);
    along(made, data.out);
    body.shape.add(made);
    shown.plumes.push(made);
    return { made, share: array(data.share), size: body.radius };
  });

  /* ---- planet, stars, rings of range ---- */
  if (scene.planet) {
    const ball = new T.SphereGeometry(scene.planet.radius, 96, 64);
    const made = new T.Mesh(ball, new T.MeshStandardMaterial({ color: 0x1d4f8c, roughness: 0.9, metalness: 0 }));
    const net = new T.LineSegments(new T.EdgesGeometry(new T.SphereGeometry(1.0004 * scene.planet.radius, 36, 18), 0.1),
      new T.LineBasicMaterial({ color: 0x9cc8ff, transparent: true, opacity: 0.16 }));
    made.add(net);
    for (let k = 1; k < 13; k++)
      made.add(new T.Mesh(new T.SphereGeometry((1 + 0.0012 * k) * scene.planet.radius, 160, 100),
        new T.MeshBasicMaterial({ color: 0x6fb6ff, transparent: true, opacity: 0.032, side: T.BackSide, depthWrite: false })));
    made.rotation.x = Math.PI / 2;
    const group = new T.Group();
    group.add(made);
    root.add(group);
    moving.push({ made: group, r: array(scene.planet.r), whole: true });
    shown.planet.push(group);
  }
  {
    let seed = 7;
    const random = () => ((seed = (seed * 16807) % 2147483647) / 2147483647);
    const points = new Float32Array(3 * 900), p = new T.Vector3();
    for (let k = 0; k < 900; k++) {
      const z = 2 * random() - 1, angle = 2 * Math.PI * random(), w = Math.sqrt(1 - z * z);
      p.set(w * Math.cos(angle), w * Math.sin(angle), z).multiplyScalar(4e8).toArray(points, 3 * k);
    }
    const stars = new T.Points(new T.BufferGeometry().setAttribute("position", new T.BufferAttribute(points, 3)),
      new T.PointsMaterial({ color: 0xb8c7e0, size: 1.4, sizeAttenuation: false, transparent: true, opacity: 0.6 }));
    root.add(stars);
  }

  /* ---- frames, cameras ---- */
  let frame = scene.frames[0], now = first, playing = false, dirty = true, follow = "overview", trueSize = false;
  const extent = (name) => {
    const sphere = new T.Box3(), p = new T.Vector3();
    for (const body of bodies) {
      const r = name === "H" ? body.hilly : body.r;
      for (let k = 0; k < r.length; k += 3) sphere.expandByPoint(p.set(r[k], r[k + 1], r[k + 2]));
      sphere.expandByPoint(p.addScalar(body.reach || body.radius)).expandByPoint(p.addScalar(-2 * (body.reach || body.radius)));
    }
    return sphere.getBoundingSphere(new T.Sphere());
  };
  const bounds = Object.fromEntries(scene.frames.map((f) => [f.key, extent(f.key)]));
  let controls;
  const newControls = () => {
    if (controls) controls.dispose();
    camera.up.set(...(frame.key === "H" ? [1, 0, 0] : [0, 0, 1]));
    controls = new T.OrbitControls(camera, canvas, { parameters: { cameraUpAxis: frame.key === "H" ? "x" : "z" } });
    controls.enableDamping = true;
    controls.dampingFactor = 0.12;
    controls.addEventListener("start", () => choose(null));
    controls.addEventListener("change", () => { dirty = true; });
  };

  const world = (body) => body.group.getWorldPosition(new T.Vector3());
  const fit = (radius) => {
    const half = Math.tan((camera.fov * Math.PI) / 360) * Math.min(1, camera.aspect);
    return ((bodies.length > 1 ? 1.12 : 0.8) * radius) / half;
  };
  const CAMERAS = {
    overview: { name: "overview", once: true, set() {
      const b = bounds[frame.key], d = frame.key === "H" ? [0.42, -0.45, 0.79] : [0.62, -0.62, 0.48];
      aim(b.center.clone().addScaledVector(new T.Vector3(...d).normalize(), fit(b.radius)), b.center);
    } },
    side: { name: "side", once: true, set() {
      const b = bounds[frame.key], d = frame.key === "H" ? [0, 0, 1] : [0, -1, 0];
      aim(b.center.clone().addScaledVector(new T.Vector3(...d), fit(b.radius)), b.center);
    } },
  };
  const chase = (from, to, name) => ({ name, set() {
    const a = world(from), b = world(to), d = b.clone().sub(a), far = d.length() || 1;
    d.normalize();
    const size = from.radius * from.shape.scale.x;
    const above = camera.up.clone().addScaledVector(d, -camera.up.dot(d));
    if (above.lengthSq() < 1e-4) above.set(0, 0, 1);
    aim(a.addScaledVector(d, -6.5 * size).addScaledVector(above.normalize(), 3.6 * size), b.lerp(world(from), far > 12 * size ? 0 : 0.3));
  } });
  if (bodies.length > 1) {
    const client = bodies[bodies.length - 1];
    CAMERAS.servicer = chase(bodies[0], client, `from ${bodies[0].name}`);
    CAMERAS.target = chase(client, bodies[0], `from ${client.name}`);
  } else {
    const close = (offset, name, fixed) => ({ name, set() {
      const body = bodies[0], size = body.reach || body.radius, d = new T.Vector3(...offset).multiplyScalar(fit(size) * 0.8);
      if (fixed) d.applyQuaternion(body.group.getWorldQuaternion(new T.Quaternion()));
      aim(world(body).add(d), world(body));
    } });
    CAMERAS.body = close([0.35, -0.6, 0.8], `with ${bodies[0].name}`, true);
    CAMERAS.behind = close([0.25, -1, 0.12], "from behind", false);
  }
  function aim(position, target) {
    camera.position.copy(position);
    controls.target.copy(target);
    camera.lookAt(target);
    dirty = true;
  }
  function choose(name) {
    follow = name;
    for (const button of part(".cameras").children) button.setAttribute("aria-pressed", button.dataset.camera === name);
    if (name) { update(); CAMERAS[name].set(); update(); }
  }
  for (const [name, { name: text }] of Object.entries(CAMERAS)) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: text });
    button.dataset.camera = name;
    button.addEventListener("click", () => choose(name));
    part(".cameras").append(button);
  }

  function setFrame(name) {
    frame = scene.frames.find((f) => f.key === name) || frame;
    for (const button of part(".frames").children) button.setAttribute("aria-pressed", button.dataset.frame === frame.key);
    newControls();
    update();
    choose(follow || "overview");
  }
  for (const f of scene.frames) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: f.key, title: f.name });
    button.dataset.frame = f.key;
    button.addEventListener("click", () => setFrame(f.key));
    part(".frames").append(button);
  }

  /* ---- what is shown ---- */
  const hidden = new Set();
  const NAMES = { axes: "body axes", marks: "zones and axes", plumes: "plumes", trails: "paths", planet: "planet", rings: "rings of range" };
  const choices = part(".shown div");
  const choice = (text, on, act) => {
    const line = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", checked: on });
    box.addEventListener("change", () => { act(box.checked); dirty = true; update(); });
    line.append(box, ` ${text}`);
    choices.append(line);
  };
  for (const [name, text] of Object.entries(NAMES))
    if (name === "trails" || name === "rings" || shown[name].length)
      choice(text, true, (on) => { if (on) hidden.delete(name); else hidden.add(name); });
  choice("true size", false, (on) => { trueSize = on; });

  /* rings about the origin in the plane of the orbit, at 1, 2, 5 times a power of ten */
  const rings = new T.Group();
  space.add(rings);
  {
    const size = Math.max(...scene.frames.map((f) => bounds[f.key].radius * 1.3));
    const power = 10 ** Math.floor(Math.log10(size));
    for (const factor of [0.1, 0.2, 0.5, 1, 2, 5]) {
      const radius = factor * power;
      if (radius > size || radius < size / 12) continue;
      const points = Array.from({ length: 129 }, (_, k) =>
        new T.Vector3(radius * Math.cos((k * Math.PI) / 64), radius * Math.sin((k * Math.PI) / 64), 0));
      const ring = new T.Line(new T.BufferGeometry().setFromPoints(points),
        new T.LineBasicMaterial({ color: 0x8aa0bd, transparent: true, opacity: 0.28 }));
      rings.add(ring);
      const mark = new T.Object3D();
      mark.position.set(0, -radius, 0);
      ring.add(mark);
      labels.push({ made: label(`${radius >= 1000 ? radius / 1000 : radius} ${radius >= 1000 ? "km" : "m"}`, mark, "#8aa0bd"), object: mark, offset: 0, ring: true });
      labels.splice(labels.length - 2, 1);
    }
  }

  /* ---- the triad of the frame in the corner ---- */
  const SVG = "http://www.w3.org/2000/svg";
  const triad = document.createElementNS(SVG, "svg");
  triad.setAttribute("viewBox", "-50 -50 100 100");
  part(".triad").append(triad);
  const limbs = [0, 1, 2].map((k) => {
    const line = document.createElementNS(SVG, "line"), text = document.createElementNS(SVG, "text");
    line.setAttribute("stroke", css(AXES[k]));
    line.setAttribute("stroke-width", 2.4);
    text.setAttribute("fill", "#d6deea");
    text.setAttribute("font-size", 10);
    text.setAttribute("text-anchor", "middle");
    triad.append(line, text);
    return { line, text };
  });
  const drawTriad = () => {
    const view = camera.quaternion.clone().conjugate();
    limbs.forEach(({ line, text }, k) => {
      const p = new T.Vector3().setComponent(k, 1).applyQuaternion(view);
      line.setAttribute("x2", 28 * p.x);
      line.setAttribute("y2", -28 * p.y);
      text.setAttribute("x", 38 * p.x);
      text.setAttribute("y", -38 * p.y + 3);
      text.textContent = frame.axes[k];
    });
  };

  /* ---- one instant ---- */
  const turn = new T.Quaternion(), p = new T.Vector3();
  function update() {
    const at = place(now);
    if (scene.hill) quaternion(array(scene.hill), at, hill.quaternion);
    root.quaternion.copy(frame.key === "H" ? turn.copy(hill.quaternion).conjugate() : turn.identity());
    if (frame.origin === "body") space.position.set(0, 0, 0);
    for (const body of bodies) {
      vector(body.r, at, body.group.position);
      quaternion(body.q, at, body.group.quaternion);
      for (const link of body.links) {
        const value = (values) => {
          if (!values) return 0;
          const n = values.shape[1] || 1, low = values[at.low * n + link.index], high = values[at.high * n + link.index];
          return low + at.part * (high - low);
        };
        link.joint.quaternion.setFromAxisAngle(p.set(...link.axis), value(link.angle));
        link.joint.position.set(...link.at).addScaledVector(p, value(link.slide));
      }
      for (const { key, lines } of body.trails) {
        const on = key === frame.key && !hidden.has("trails");
        lines.forEach((line) => { line.visible = on; });
        lines[1].geometry.setDrawRange(0, at.low + 1);
      }
    }
    for (const { made, r } of moving) vector(r, at, made.position);
    for (const { made, share, size } of plumes) {
      const value = scalar(share, at);
      made.visible = value > 0.004 && !hidden.has("plumes");
      const long = size * (0.25 + 2.2 * Math.sqrt(Math.max(0, value)));
      made.scale.set(long, long, long);
    }
    for (const name of ["axes", "marks", "planet"]) for (const o of shown[name]) o.visible = !hidden.has(name);
    rings.visible = !hidden.has("rings");
    root.updateMatrixWorld(true);
    if (follow && !CAMERAS[follow].once) CAMERAS[follow].set();
    resize();
    writeNumbers(at);
    dirty = true;
  }

  /* bodies that would be too small to be seen are enlarged, never so far that they touch */
  function resize() {
    const height = canvas.clientHeight || 1, view = 2 * Math.tan((camera.fov * Math.PI) / 360);
    const client = world(bodies[bodies.length - 1]);
    const gap = Math.min(...bodies.slice(0, -1).map((body) => world(body).distanceTo(client)));
    let largest = 1;
    for (const body of bodies) {
      const size = body.reach || body.radius, distance = camera.position.distanceTo(world(body));
      const wanted = (26 * distance * view) / height / size;
      const scale = trueSize ? 1 : Math.max(1, Math.min(wanted, (0.33 * gap) / size));
      body.shape.scale.setScalar(scale);
      largest = Math.max(largest, scale);
    }
    for (const { made, whole } of moving)
      if (!whole) made.scale.setScalar((5 * camera.position.distanceTo(made.getWorldPosition(p)) * view) / height);
    scaleText = largest > 1.05 ? `bodies drawn ${largest.toPrecision(2)} times as large` : "";
  }
  let scaleText = "";

  const unit = (value, name) => Math.abs(value) >= 1000 && name === "m" ? `${(value / 1000).toFixed(3)} km` : `${value.toPrecision(4)} ${name}`;
  function writeNumbers(at) {
    const lines = [];
    if (scene.range) lines.push(`<b>${unit(scalar(array(scene.range), at), "m")}</b> range`);
    if (scene.speed) lines.push(`<span>${unit(scalar(array(scene.speed), at), "m/s")} relative speed</span>`);
    for (const extra of scene.numbers || [])
      if (extra.words) lines.push(`<span><b>${escaped(extra.words[array(extra.values)[at.part < 1 ? at.low : at.high]])}</b> ${escaped(extra.name)}</span>`);
      else lines.push(`<span>${(extra.factor * scalar(array(extra.values), at)).toPrecision(4)} ${extra.unit === "1" ? "" : escaped(extra.unit)} ${escaped(extra.name)}</span>`);
    lines.push(`<span>${frame.name}, origin: ${escaped(scene.origin)}</span>`);
    const past = (scene.events || []).filter((event) => event.time <= now).pop();
    if (past) lines.push(`<span>${past.time.toFixed(1)} s: ${escaped(past.text)}</span>`);
    if (scaleText) lines.push(`<span>${scaleText}</span>`);
    part(".readout").innerHTML = lines.join("");
    part(".clock").value = `${now.toFixed(last - first > 500 ? 0 : 1)} / ${last.toPrecision(6).replace(/\.?0+$/, "")} s`;
    const scrub = part(".scrub");
    if (document.activeElement !== scrub || playing) scrub.value = (now - first) / (last - first || 1);
    document.dispatchEvent(new CustomEvent("replay", { detail: now }));
  }

  function placeLabels() {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    for (const { made, object, offset, ring } of labels) {
      object.getWorldPosition(p).project(camera);
      const visible = p.z < 1 && Math.abs(p.x) < 1 && Math.abs(p.y) < 1 && !(ring && hidden.has("rings"));
      made.style.display = visible ? "block" : "none";
      made.style.transform = `translate(${((p.x + 1) / 2) * width + 14 * offset}px, ${((1 - p.y) / 2) * height - 30 * offset}px)`;
    }
  }

  /* ---- time ---- */
  const span = last - first, select = part(".speed");
  const speeds = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].filter((s) => span / s > 3 && span / s < 4000);
  const natural = speeds.reduce((a, b) => (Math.abs(Math.log(span / b / 40)) < Math.abs(Math.log(span / a / 40)) ? b : a), speeds[0] || 1);
  for (const s of speeds.length ? speeds : [1]) select.append(new Option(`${s}×`, s, s === natural, s === natural));
  const play = (on) => {
    playing = on;
    if (on && now >= last) now = first;
    part(".play").textContent = on ? "\u275A\u275A" : "\u25B6";
    part(".play").setAttribute("aria-pressed", on);
    update();
  };
  const ticks = Object.assign(document.createElement("datalist"), { id: "events" });
  for (const event of scene.events || []) ticks.append(new Option(event.text, (event.time - first) / (span || 1)));
  stage.append(ticks);
  part(".scrub").setAttribute("list", ticks.id);
  const seek = (t) => { now = Math.min(last, Math.max(first, t)); update(); };
  part(".play").addEventListener("click", () => play(!playing));
  part(".scrub").addEventListener("input", (event) => seek(first + event.target.value * span));
  part(".full").addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : stage.requestFullscreen()));
  canvas.tabIndex = 0;
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 0.01, ArrowLeft: -0.01 }[event.key];
    if (event.key === " ") play(!playing); else if (step) seek(now + step * span); else return;
    event.preventDefault();
  });

  const fitCanvas = () => {
    const width = stage.clientWidth, height = stage.clientHeight;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (follow) choose(follow);
    dirty = true;
  };
  let before = 0, visible = true, ended = false;
  const beat = (stamp) => {
    if (ended) return;
    requestAnimationFrame(beat);
    if (!visible) { before = 0; return; }
    const passed = before ? Math.min(0.1, (stamp - before) / 1000) : 0;
    before = stamp;
    if (playing) {
      now = Math.min(last, now + passed * select.value);
      if (now >= last) play(false);
      update();
    }
    controls.update();
    if (!dirty) return;
    dirty = false;
    sun.position.copy(camera.position).addScaledVector(camera.up, camera.position.length() * 0.8);
    if (!playing) resize();
    renderer.render(space, camera);
    placeLabels();
    drawTriad();
  };
  setFrame(frame.key);
  const watching = [new ResizeObserver(fitCanvas), new IntersectionObserver(([entry]) => { visible = entry.isIntersecting; })];
  for (const each of watching) each.observe(stage);
  fitCanvas();
  update();
  requestAnimationFrame(beat);
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);

  const state = () => ({
    time: now, playing, frame: frame.key, camera: follow, speed: Number(select.value),
    eye: camera.position.toArray(),
    bodies: Object.fromEntries(bodies.map((b) => [b.name, {
      position: world(b).toArray(), attitude: b.group.getWorldQuaternion(new T.Quaternion()).toArray(),
      joints: b.links.map((l) => l.joint.quaternion.toArray()),
      places: b.links.map((l) => l.joint.position.toArray()) }])),
    plumes: plumes.filter((each) => each.made.visible).length,
  });
  const dispose = () => {
    ended = true;
    for (const each of watching) each.disconnect();
    controls.dispose();
    renderer.dispose();
    renderer.forceContextLoss();
  };
  return { seek, play, setFrame, choose, state, dispose };
}
