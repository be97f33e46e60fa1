/* Shapes of the parts of bodies as meshes of three.js: boxes, rods, nozzles and so on, in body
 * axes. */
"use strict";
const BODY_COLOURS = [0x56b4e9, 0xe69f00, 0x00b587, 0xcc79a7, 0xf0e442, 0x3d8fd1, 0xff7f3f, 0xd0d6e0];
const AXIS_COLOURS = [0xd55e00, 0x009e73, 0x4aa3ff];
const bodyColour = (which) => BODY_COLOURS[which % BODY_COLOURS.length];

function makeShapes(T) {
  const up = new T.Vector3(0, 1, 0);
  const css = (colour) => `#${new T.Color(colour).getHexString(T.LinearSRGBColorSpace)}`;
  const solid = (colour, about = {}) =>
    new T.MeshStandardMaterial({ color: colour, roughness: 0.6, metalness: 0.12, ...about });
  const glow = (colour, opacity) => new T.MeshBasicMaterial({
    color: colour, transparent: true, opacity, depthWrite: false, side: T.DoubleSide });
  const lines = (colour, opacity) => new T.LineBasicMaterial({ color: colour, transparent: true, opacity });
  const points = (list) => new T.BufferGeometry().setFromPoints(list);

  /* materials of a body, in the colour of its label; its hull is paler */
  function looks(which) {
    const own = bodyColour(which), pale = new T.Color(own).lerp(new T.Color(0xe8ebf0), 0.55);
    return {
      hull: solid(pale), panel: solid(0x1b3a86, { roughness: 0.35, metalness: 0.3 }),
      metal: solid(0x8d97a6, { metalness: 0.4 }), accent: solid(own),
      arm: solid(0xf7f4e3, { emissive: 0x3a3524 }), second: solid(0xa9b7c6), fluid: solid(0x4fb3ff),
      tank: glow(0x9cc8ff, 0.16),
      shell: solid(pale, { transparent: true, opacity: 0.35, depthWrite: false }),
    };
  }

  const along = (object, direction) => {
    object.quaternion.setFromUnitVectors(up, new T.Vector3(...direction).normalize());
    return object;
  };
  const outline = (geometry, colour) => new T.LineSegments(new T.EdgesGeometry(geometry), lines(colour, 0.55));

  /* a cylinder or truncated cone between two points, open at its ends if `open` */
  function spindle(from, to, radii, material, open) {
    const a = new T.Vector3(...from), b = new T.Vector3(...to), d = b.clone().sub(a);
    const made = new T.Mesh(new T.CylinderGeometry(radii[1], radii[0], d.length(), 24, 1, open), material);
    made.position.copy(a.add(b).multiplyScalar(0.5));
    return along(made, d.toArray());
  }
  const twoSided = (material) => Object.assign(material.clone(), { side: T.DoubleSide });

  /* lines between the solar cells on both sides of a flat box (panel) */
  function cells(size) {
    const flat = size.indexOf(Math.min(...size)), [i, j] = [0, 1, 2].filter((k) => k !== flat);
    const found = [], cell = Math.max(size[i], size[j]) / 8;
    for (const [a, b] of [[i, j], [j, i]]) {
      const n = Math.max(1, Math.round(size[a] / cell));
      for (let k = 1; k < n; k++)
        for (const side of [-0.52, 0.52])
          for (const end of [-0.5, 0.5]) {
            const p = [0, 0, 0];
            p[a] = size[a] * (k / n - 0.5); p[b] = size[b] * end; p[flat] = size[flat] * side;
            found.push(new T.Vector3(...p));
          }
    }
    return new T.LineSegments(points(found), lines(0x8fb4ff, 0.45));
  }

  const KINDS = {
    box(p, look) {
      const geometry = new T.BoxGeometry(...p.size), made = new T.Mesh(geometry, look[p.look]);
      made.add(p.look === "panel" ? cells(p.size) : outline(geometry, 0x10151f));
      made.position.set(...p.at);
      return made;
    },
    rod: (p, look) => spindle(p.from, p.to, [p.radius, p.radius], look[p.look], false),
    cup: (p, look) => spindle(p.from, p.to, p.radii, twoSided(look.metal), true),
    ball(p, look) {
      const made = new T.Mesh(new T.SphereGeometry(p.radius, 20, 14), look[p.look]);
      made.position.set(...p.at);
      return made;
    },
    nozzle(p, look) {
      const made = new T.Mesh(new T.CylinderGeometry(0.9 * p.size, 0.35 * p.size, p.size, 14, 1, true),
        twoSided(look.metal));
      made.position.set(...p.at);
      return along(made, p.out);
    },
    ring(p, look) {
      const made = new T.Group();
      made.add(new T.Mesh(new T.TorusGeometry(p.radius, 0.14 * p.radius, 10, 40), look.accent));
      made.children[0].rotateX(Math.PI / 2);
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

  return {
    css, solid, glow, lines, points, looks, along,
    fill(group, parts, look) { for (const p of parts) group.add(KINDS[p.kind](p, look)); },
    arrow(axis, length, colour) {
      const made = new T.ArrowHelper(new T.Vector3().setComponent(axis, 1), new T.Vector3(), length,
        colour, 0.16 * length, 0.08 * length);
      made.traverse((o) => { if (o.material) o.material.depthTest = false; o.renderOrder = 5; });
      return made;
    },
  };
}
