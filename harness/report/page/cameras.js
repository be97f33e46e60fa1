/* Cameras of a replay: position of the eye, point that it looks at, and field of view. All cameras
 * except `side` follow the bodies at every instant. */
"use strict";
const FIELD = 38;

function makeCameras(view, bodies) {
  const { T, scene, canvas, camera } = view;
  const client = bodies.list[bodies.list.length - 1], chaser = bodies.list[0];
  const pair = bodies.list.length > 1, vec = (...x) => new T.Vector3(...x);

  /* sphere that contains all positions of the bodies in the named frame */
  function extent(name) {
    const box = new T.Box3(), p = new T.Vector3();
    for (const body of bodies.list) {
      const r = name === "H" ? body.hilly : body.r;
      for (let k = 0; k < r.length; k += 3) {
        box.expandByPoint(p.set(r[k], r[k + 1], r[k + 2]).addScalar(body.size));
        box.expandByPoint(p.addScalar(-2 * body.size));
      }
    }
    return box.getBoundingSphere(new T.Sphere());
  }
  const bounds = Object.fromEntries(scene.frames.map((f) => [f.key, extent(f.key)]));

  const half = () => Math.tan((camera.fov * Math.PI) / 360);
  const narrow = () => half() * Math.min(1, camera.aspect);
  const aim = (eye, at) => ({ eye, at });

  /* Direction of view in the named frame in which the two bodies hide one another least. Its angle
   * to the line between the bodies, at the instant at which this angle is smallest, is as large as
   * possible. */
  function calmest(name) {
    const options = [vec(0.42, -0.45, 0.79), vec(0, 0, 1), vec(0.62, -0.62, 0.48), vec(0.8, 0, 0.6), vec(0, -1, 0), vec(1, 0, 0)]
      .map((v) => v.normalize());
    if (!pair) return options[name === "H" ? 0 : 2];
    const key = name === "H" ? "hilly" : "r", a = chaser[key], b = client[key], d = new T.Vector3();
    const worst = options.map(() => 1);
    const stride = 3 * Math.max(1, Math.floor(a.length / 600));
    for (let k = 0; k < a.length; k += stride) {
      d.set(a[k] - b[k], a[k + 1] - b[k + 1], a[k + 2] - b[k + 2]).normalize();
      options.forEach((v, i) => { worst[i] = Math.min(worst[i], 1 - Math.abs(v.dot(d))); });
    }
    return options[worst.indexOf(Math.max(...worst))];
  }
  const calm = Object.fromEntries(scene.frames.map((f) => [f.key, calmest(f.key)]));

  /* Camera that shows both bodies; the distance between them is a third of the picture. When they
   * are close to each other, each body fills a third of the picture. */
  function overview() {
    if (!pair) return whole(calm[view.frame.key]);
    const a = bodies.world(chaser), b = bodies.world(client), d = b.clone().sub(a), far = d.length();
    const n = calm[view.frame.key].clone();
    if (far > 0) n.addScaledVector(d, -n.dot(d) / far ** 2);
    if (n.lengthSq() < 0.02) n.copy(camera.up).addScaledVector(d, -camera.up.dot(d) / far ** 2);
    n.normalize();
    const right = camera.up.clone().cross(n).normalize(), along = Math.abs(d.dot(right));
    const across = Math.sqrt(Math.max(0, far ** 2 - along ** 2));
    const apart = (1.5 * Math.max(along / camera.aspect, across)) / half();
    const close = (2.2 * Math.max(chaser.size, client.size)) / narrow();
    const middle = a.lerp(b, 0.5);
    return aim(middle.clone().addScaledVector(n, Math.max(apart, close)), middle);
  }
  function whole(direction) {
    const b = bounds[view.frame.key];
    return aim(b.center.clone().addScaledVector(direction, ((pair ? 1.12 : 0.8) * b.radius) / narrow()), b.center.clone());
  }

  /* Camera behind the body `from`, which looks at the body `to`. It is so high above the line
   * between the bodies that the sphere around `from` does not hide `to`. */
  function chase(from, to) {
    const a = bodies.world(from), b = bodies.world(to), d = b.clone().sub(a), far = d.length() || 1;
    d.normalize();
    const above = camera.up.clone().addScaledVector(d, -camera.up.dot(d));
    if (above.lengthSq() < 1e-3) above.copy(calm[view.frame.key]).addScaledVector(d, -calm[view.frame.key].dot(d));
    const clear = 1.15 * from.girth * from.shape.scale.x;
    const angle = Math.max(0.12, Math.asin(Math.min(1, clear / far)));
    const distance = far * Math.cos(angle) + 5 * from.size * from.shape.scale.x + 0.4 * clear;
    const eye = b.clone().addScaledVector(d, -Math.cos(angle) * distance).addScaledVector(above.normalize(), Math.sin(angle) * distance);
    return aim(eye, b);
  }
  for (const body of bodies.list) body.girth = girth(body);
  /* radius of the sphere around all parts of a body, including panels */
  function girth(body) {
    body.group.updateMatrixWorld(true);
    const box = new T.Box3();
    body.shape.traverse((o) => { if (o.isMesh && o.material.blending !== T.AdditiveBlending && !o.parent.line) box.expandByObject(o); });
    const centre = bodies.world(body);
    if (box.isEmpty()) return body.size;
    return Math.max(box.min.distanceTo(centre), box.max.distanceTo(centre));
  }

  /* Camera at the position of a sensor, with its axis and field of view. The body that carries the
   * sensor is hidden. */
  function sensor(data) {
    const body = bodies.named[data.body], turn = body.group.getWorldQuaternion(new T.Quaternion());
    const out = vec(...data.axis).applyQuaternion(turn), eye = vec(...data.at).applyQuaternion(turn).add(bodies.world(body));
    return { eye, at: eye.clone().add(out), up: vec(...data.up).applyQuaternion(turn), field: (data.field * 180) / Math.PI, from: body };
  }
  function close(body, offset, fixed) {
    const d = vec(...offset).multiplyScalar((0.64 * body.size) / narrow());
    if (fixed) d.applyQuaternion(body.group.getWorldQuaternion(new T.Quaternion()));
    const at = bodies.world(body);
    return aim(at.clone().add(d), at);
  }

  const list = {
    overview: { text: "overview", at: overview },
    side: { text: "side", once: true, at: () => whole(vec(...(view.frame.key === "H" ? [0, 0, 1] : [0, -1, 0]))) },
  };
  if (pair) {
    list.servicer = { text: `from ${chaser.name}`, at: () => chase(chaser, client), looks: client };
    list.target = { text: `from ${client.name}`, at: () => chase(client, chaser), looks: chaser };
  } else {
    list.body = { text: `with ${chaser.name}`, at: () => close(chaser, [0.35, -0.6, 0.8], true) };
    list.behind = { text: "from behind", at: () => close(chaser, [0.25, -1, 0.12], false) };
  }
  (scene.sensors || []).forEach((data, k) => {
    list[`sensor${k || ""}`] = { text: data.text, title: data.title, sensor: true, at: () => sensor(data) };
  });

  let controls;
  /* creates the controls with which mouse and touch rotate the view; the axis of rotation depends
   * on the frame */
  function renew() {
    if (controls) controls.dispose();
    const axis = view.frame.key === "H" ? "x" : "z";
    camera.up.set(...(axis === "x" ? [1, 0, 0] : [0, 0, 1]));
    controls = new T.OrbitControls(camera, canvas, { parameters: { cameraUpAxis: axis } });
    controls.enableDamping = true;
    controls.dampingFactor = 0.12;
    controls.addEventListener("start", () => choose(null));
    controls.addEventListener("change", () => { view.dirty = true; });
  }

  /* vertical field of view of a picture [deg] that contains the circle of a sensor's field of view
   * [deg] with a margin */
  function widened(field) {
    const edge = Math.tan((field * Math.PI) / 360), fov = (360 / Math.PI) * Math.atan((1.12 * edge) / Math.min(1, camera.aspect));
    const radius = (edge / Math.tan((fov * Math.PI) / 360)) * (canvas.clientHeight / 2);
    view.part(".sight").style.setProperty("--radius", `${radius}px`);
    return fov;
  }

  let chosen = "overview", masked = null;
  function set() {
    if (!chosen) return;
    const found = list[chosen].at();
    camera.fov = found.field ? widened(found.field) : FIELD;
    camera.updateProjectionMatrix();
    camera.position.copy(found.eye);
    if (masked) masked.shape.visible = true;
    masked = found.from || null;
    if (masked) masked.shape.visible = false;
    controls.target.copy(found.at);
    const up = camera.up.clone();
    if (found.up) camera.up.copy(found.up);
    camera.lookAt(found.at);
    camera.up.copy(up);
    view.part(".sight").classList.toggle("gone", !found.field);
    view.zones.hide("view", !!found.field);
    view.dirty = true;
  }
  function choose(name) {
    chosen = name;
    for (const button of view.part(".cameras").children) button.setAttribute("aria-pressed", button.dataset.camera === name);
    if (!name || !list[name].sensor) {
      if (masked) masked.shape.visible = true;
      masked = null;
      view.part(".sight").classList.add("gone");
      view.zones.hide("view", false);
      if (camera.fov !== FIELD) { camera.fov = FIELD; camera.updateProjectionMatrix(); }
    }
    if (name) view.update(true);
  }

  view.part(".cameras").replaceChildren(...Object.entries(list).map(([name, { text, title }]) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: text, title: title || "" });
    button.dataset.camera = name;
    button.addEventListener("click", () => choose(name));
    return button;
  }));

  /* name of the body nearest to the eye in the middle of the picture */
  const ray = new T.Raycaster();
  function first() {
    ray.set(camera.position, controls.target.clone().sub(camera.position).normalize());
    ray.camera = camera;
    const hit = bodies.list.flatMap((body) => {
      if (!body.shape.visible) return [];
      const solids = [];
      body.shape.traverse((o) => { if (o.isMesh && o.material.isMeshStandardMaterial) solids.push(o); });
      return ray.intersectObjects(solids, false).map(({ distance }) => ({ distance, name: body.name }));
    });
    return hit.sort((x, y) => x.distance - y.distance)[0]?.name || null;
  }

  return { list, bounds, renew, choose, first,
    /* once: whether to set the camera even if it does not follow the bodies (`side`) */
    set(once) { if (chosen && (once || !list[chosen].once)) set(); },
    move() { if (!chosen || list[chosen].once) controls.update(); },
    get chosen() { return chosen; },
    next() { const names = Object.keys(list); choose(names[(names.indexOf(chosen) + 1) % names.length]); },
    dispose() { controls.dispose(); } };
}
