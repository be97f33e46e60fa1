/* Bodies of a replay with their joints, paths, planned paths, body axes and plumes. place(at) shows
 * all of these as they are at the instant `at`, from place() of history.js. */
"use strict";
const PLANNED = [0xf5f7fa, 0x7d8794]; /* colours of a planned path: present plan, older plan */
function makeBodies(view) {
  const { T, scene, array, root, space, shapes, history, labels } = view;
  const axes = [], plumes = [], p = new T.Vector3();

  /* positions r (3 numbers each) in axes of frame N, as an array in axes of frame H */
  function inHill(r) {
    if (!scene.hill) return r;
    const q = array(scene.hill), turn = new T.Quaternion(), out = new Float32Array(r.length);
    for (let k = 0; k < r.length / 3; k++) {
      p.set(r[3 * k], r[3 * k + 1], r[3 * k + 2]).applyQuaternion(history.quaternionAt(q, k, turn).conjugate());
      p.toArray(out, 3 * k);
    }
    return out;
  }

  function joint(link, look) {
    const made = new T.Group();
    shapes.fill(made, link.parts, link.look ? { ...look, hull: look[link.look] } : look);
    return { ...link, joint: made, index: link.index || 0,
      angle: link.angle && array(link.angle), slide: link.slide && array(link.slide) };
  }

  function trail(key, points, colour) {
    return [[0.28, 0x9fb3c8], [1, bodyColour(colour)]].map(([opacity, tint]) => {
      const geometry = new T.BufferGeometry().setAttribute("position", new T.BufferAttribute(points, 3));
      const line = new T.Line(geometry, shapes.lines(tint, opacity));
      line.frustumCulled = false;
      (key === "H" ? space : root).add(line);
      return line;
    });
  }

  const bodies = scene.bodies.map((data) => {
    const group = new T.Group(), shape = new T.Group(), look = shapes.looks(data.colour);
    group.add(shape);
    root.add(group);
    shapes.fill(shape, data.parts, look);
    const links = data.links.map((link) => joint(link, look));
    for (const link of links) (link.on === undefined ? shape : links[link.on].joint).add(link.joint);
    for (const axis of [0, 1, 2]) {
      axes.push(shapes.arrow(axis, data.radius * 1.7, AXIS_COLOURS[axis]));
      shape.add(axes[axes.length - 1]);
    }
    labels.add(data.name, group, shapes.css(bodyColour(data.colour)), { leader: true, size: () => data.radius * shape.scale.x });
    const r = array(data.r), body = { ...data, group, shape, links, r, q: array(data.q), hilly: inHill(r) };
    body.size = data.reach || data.radius;
    body.trails = data.trail ? scene.frames.map(({ key }) =>
      ({ key, lines: trail(key, key === "H" ? body.hilly : r, data.colour) })) : [];
    return body;
  });
  const named = Object.fromEntries(bodies.map((body) => [body.name, body]));

  /* spots: points of bodies that are drawn as balls with a label */
  for (const spot of scene.spots || []) {
    const made = new T.Mesh(new T.SphereGeometry(0.06 * named[spot.body].radius, 12, 8), shapes.glow(0xff5fd2, 0.95));
    made.position.set(...spot.at);
    named[spot.body].shape.add(made);
    labels.add(spot.text, made, "#ff9be4", { leader: true, title: spot.title, near: 14 * named[spot.body].radius });
  }

  /* planned paths: lines from a body through the points of its plan, which are relative to the
   * position of the body scene.centre */
  const plans = (scene.plans || []).map((data) => {
    const points = array(data.points), size = points.shape[1];
    const geometry = new T.BufferGeometry().setAttribute("position", new T.BufferAttribute(new Float32Array(size + 3), 3));
    const made = new T.Line(geometry, shapes.lines(PLANNED[0], 0.9));
    made.frustumCulled = false;
    root.add(made);
    return { made, points, size, mode: array(data.mode), body: named[data.body], vertices: geometry.attributes.position };
  });

  /* plumes of thrusters: cones whose length and brightness increase with the command */
  for (const data of scene.plumes || []) {
    const geometry = new T.CylinderGeometry(0.22, 0.03, 1, 18, 8, true);
    geometry.translate(0, 0.5, 0);
    const y = geometry.attributes.position, fade = new Float32Array(3 * y.count);
    for (let k = 0; k < y.count; k++) fade.fill((1 - y.getY(k)) ** 1.6, 3 * k, 3 * k + 3);
    geometry.setAttribute("color", new T.BufferAttribute(fade, 3));
    const made = new T.Mesh(geometry, new T.MeshBasicMaterial({ color: 0x9fd8ff, vertexColors: true,
      transparent: true, blending: T.AdditiveBlending, depthWrite: false, side: T.DoubleSide }));
    made.position.set(...data.at);
    shapes.along(made, data.out);
    named[data.body].shape.add(made);
    plumes.push({ made, share: array(data.share), size: named[data.body].radius });
  }

  function place(at) {
    for (const body of bodies) {
      history.vector(body.r, at, body.group.position);
      history.quaternion(body.q, at, body.group.quaternion);
      for (const link of body.links) {
        const value = (values) => (values ? history.column(values, at, link.index) : 0);
        link.joint.quaternion.setFromAxisAngle(p.set(...link.axis), value(link.angle));
        link.joint.position.set(...link.at).addScaledVector(p, value(link.slide));
      }
      for (const { key, lines } of body.trails) {
        for (const line of lines) line.visible = key === view.frame.key && !view.hidden.has("trails");
        lines[1].geometry.setDrawRange(0, at.low + 1);
      }
    }
    for (const { made, points, size, mode, body, vertices } of plans) {
      const now = history.state(mode, at), row = at.part < 1 ? at.low : at.high;
      made.visible = now in PLANNED && !view.hidden.has("plans");
      if (!made.visible) continue;
      made.material.color.set(PLANNED[now]);
      made.position.copy(named[scene.centre].group.position);
      p.copy(body.group.position).sub(made.position).toArray(vertices.array);
      vertices.array.set(points.subarray(size * row, size * (row + 1)), 3);
      vertices.needsUpdate = true;
    }
    for (const { made, share, size } of plumes) {
      const value = Math.min(1, Math.max(0, history.scalar(share, at))), long = size * (0.25 + 2.2 * Math.sqrt(value));
      made.visible = value > 0.004 && !view.hidden.has("plumes");
      made.scale.setScalar(long);
      made.material.opacity = Math.min(1, 0.25 + Math.sqrt(value));
    }
    for (const made of axes) made.visible = !view.hidden.has("axes");
  }

  const world = (body) => body.group.getWorldPosition(new T.Vector3());

  /* Enlarges bodies that would be too small to be seen, but never so much that they touch. Returns
   * the largest factor by which a body is enlarged. */
  function resize(camera, height) {
    const field = 2 * Math.tan((camera.fov * Math.PI) / 360), client = world(bodies[bodies.length - 1]);
    const gap = Math.min(...bodies.slice(0, -1).map((body) => world(body).distanceTo(client)));
    let largest = 1;
    for (const body of bodies) {
      const wanted = (34 * camera.position.distanceTo(world(body)) * field) / height / body.size;
      const scale = view.trueSize ? 1 : Math.max(1, Math.min(wanted, (0.33 * gap) / body.size));
      body.shape.scale.setScalar(scale);
      largest = Math.max(largest, scale);
    }
    return largest;
  }

  return { list: bodies, named, plumes, plans, place, world, resize, has: { axes, plumes } };
}
