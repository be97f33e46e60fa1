/* Zones, corridors, and the axes of frames and references. A zone that belongs to a safety rule is
 * red while this rule is violated, and faint while the rule does not apply. */
"use strict";
const RESTS = 0, HOLDS = 1, VIOLATED = 2;
const ZONE_COLOURS = { ellipsoid: 0xe6b450, cuboid: 0xe6b450, cone: 0x00b587, axis: 0xf0e442,
  point: 0xcc79a7, view: 0x9cc8ff };
const ALARM = 0xff2d2d;

function makeZones(view, bodies) {
  const { T, scene, array, root, hill, shapes, history } = view;
  const key = view.part(".key"), moving = [];

  function zone(geometry, colour) {
    const made = new T.Mesh(geometry, shapes.glow(colour, 0.07));
    made.add(new T.LineSegments(new T.EdgesGeometry(geometry, 1),
      Object.assign(shapes.lines(colour, 0.2), { depthWrite: false })));
    return made;
  }
  function cone(m, colour) {
    const made = new T.Group(), inside = zone(new T.ConeGeometry(m.length * Math.tan(m.angle), m.length, 24, 5, true), colour);
    inside.position.y = m.length / 2;
    inside.rotation.x = Math.PI;
    made.add(inside);
    made.position.set(...m.at);
    return shapes.along(made, m.axis);
  }
  const scaled = (made, half) => { made.scale.set(...half); return made; };
  const KINDS = {
    ellipsoid: (m, colour) => scaled(zone(new T.SphereGeometry(1, 24, 16), colour), m.half),
    cuboid: (m, colour) => scaled(zone(new T.BoxGeometry(2, 2, 2), colour), m.half),
    cone,
    view: cone,
    axis(m, colour) {
      const end = new T.Vector3(...m.axis).multiplyScalar(m.length);
      const line = new T.Line(shapes.points([new T.Vector3(), end]),
        new T.LineDashedMaterial({ color: colour, dashSize: m.length / 60, gapSize: m.length / 90 }));
      line.computeLineDistances();
      return line;
    },
    point(m, colour) {
      const made = new T.Mesh(new T.OctahedronGeometry(1), shapes.glow(colour, 0.95));
      moving.push({ made, r: array(m.r) });
      return made;
    },
  };

  function entry(m) {
    const line = document.createElement("div"), swatch = document.createElement("i");
    line.append(m.text, swatch);
    if (m.title) line.title = m.title;
    key.append(line);
    return { line, swatch };
  }

  key.replaceChildren();
  const zones = (scene.zones || []).map((m) => {
    const carrier = m.on === "H" ? hill : m.on === "N" ? root : bodies.named[m.on].group;
    const made = KINDS[m.kind](m, ZONE_COLOURS[m.kind]);
    carrier.add(made);
    return { ...m, made, ...entry(m), states: m.state && array(m.state), now: HOLDS };
  });

  function paint(zone, state) {
    const colour = state === VIOLATED ? ALARM : ZONE_COLOURS[zone.kind];
    const strength = [0.35, 1, 3.2][state];
    zone.made.traverse((o) => {
      if (!o.material) return;
      o.material.color.set(colour);
      o.material.opacity = (o.isMesh ? 0.07 : 0.2) * strength;
    });
    zone.swatch.style.borderColor = shapes.css(colour);
    zone.line.classList.toggle("violated", state === VIOLATED);
    zone.line.classList.toggle("resting", state === RESTS);
    zone.now = state;
  }
  for (const zone of zones) zone.swatch.style.borderColor = shapes.css(ZONE_COLOURS[zone.kind]);
  if (bodies.plans.length) entry({ text: "planned path" }).swatch.style.borderColor = shapes.css(PLANNED[0]);

  const away = new Set();
  return {
    list: zones,
    /* hides all zones of a kind, for a camera whose view they would obstruct */
    hide(kind, on) {
      if (on) away.add(kind); else away.delete(kind);
      for (const zone of zones) if (zone.kind === kind) zone.made.visible = !on;
    },
    place(at) {
      for (const { made, r } of moving) history.vector(r, at, made.position);
      for (const zone of zones) {
        zone.made.visible = !view.hidden.has("zones") && !away.has(zone.kind);
        if (zone.states) paint(zone, history.state(zone.states, at));
      }
    },
    resize(camera, height) {
      const field = 2 * Math.tan((camera.fov * Math.PI) / 360), p = new T.Vector3();
      for (const { made } of moving)
        made.scale.setScalar((5 * camera.position.distanceTo(made.getWorldPosition(p)) * field) / height);
    },
  };
}
