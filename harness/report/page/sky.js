/* Surroundings of the bodies: planet with its night side, Sun and shadow, stars, rings that show
 * distances. */
"use strict";
const DAY = 0.95, NIGHT = 1.5;   /* ambient light in sunlight, in the shadow of the planet */

function makeSky(view) {
  const { T, scene, array, root, space, shapes, history, labels } = view;
  const ambient = new T.HemisphereLight(0xdfe9ff, 0x2a3040, scene.sun ? DAY : 1.3);
  const light = new T.DirectionalLight(0xffffff, 1.5), towards = new T.Vector3(1, 0, 0);
  space.add(ambient, light);

  /* texture of the planet with land, coasts and a grid of 15 degrees */
  function map(coasts) {
    const canvas = Object.assign(document.createElement("canvas"), { width: 4096, height: 2048 });
    const pen = canvas.getContext("2d"), x = (lon) => ((lon + 180) / 360) * 4096, y = (lat) => ((90 - lat) / 180) * 2048;
    pen.fillStyle = "#17477f";
    pen.fillRect(0, 0, 4096, 2048);
    pen.beginPath();
    for (const ring of coasts) {
      pen.moveTo(x(ring[0] / 10), y(ring[1] / 10));
      for (let k = 2; k < ring.length; k += 2) pen.lineTo(x(ring[k] / 10), y(ring[k + 1] / 10));
      pen.closePath();
    }
    Object.assign(pen, { fillStyle: "#4d7a4a", strokeStyle: "#d8e6c8", lineWidth: 2.5 });
    pen.fill("evenodd");
    pen.stroke();
    Object.assign(pen, { strokeStyle: "#9cc8ff38", lineWidth: 1.5 });
    pen.beginPath();
    for (let lon = -180; lon < 180; lon += 15) { pen.moveTo(x(lon), 0); pen.lineTo(x(lon), 2048); }
    for (let lat = -75; lat < 90; lat += 15) { pen.moveTo(0, y(lat)); pen.lineTo(4096, y(lat)); }
    pen.stroke();
    return Object.assign(new T.CanvasTexture(canvas), { anisotropy: 2 });
  }

  function planetOf(data) {
    const material = new T.ShaderMaterial({
      uniforms: { map: { value: map(data.coasts ? view.coasts : []) }, sun: { value: towards }, lit: { value: scene.sun ? 1 : 0 } },
      vertexShader: `
        #include <common>
        #include <logdepthbuf_pars_vertex>
        varying vec2 place; varying vec3 outward;
        void main() {
          place = uv;
          outward = normalize((modelMatrix * vec4(normal, 0.0)).xyz);
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
          #include <logdepthbuf_vertex>
        }`,
      fragmentShader: `
        #include <common>
        #include <logdepthbuf_pars_fragment>
        uniform sampler2D map; uniform vec3 sun; uniform float lit;
        varying vec2 place; varying vec3 outward;
        void main() {
          #include <logdepthbuf_fragment>
          float day = lit > 0.5 ? smoothstep(-0.1, 0.16, dot(normalize(outward), sun)) : 0.85;
          gl_FragColor = vec4(texture2D(map, place).rgb * mix(0.12, 1.15, day), 1.0);
        }`,
    });
    const made = new T.Mesh(new T.SphereGeometry(data.radius, 128, 96), material);
    for (let k = 1; k < 4; k++)
      made.add(new T.Mesh(new T.SphereGeometry((1 + 0.004 * k) * data.radius, 96, 64),
        new T.MeshBasicMaterial({ color: 0x6fb6ff, transparent: true, opacity: 0.07, side: T.BackSide, depthWrite: false })));
    made.rotation.x = Math.PI / 2;
    const turning = new T.Group(), group = new T.Group();
    turning.add(made);
    group.add(turning);
    root.add(group);
    return { group, turning, r: array(data.r), turn: array(data.turn) };
  }
  const planet = scene.planet && planetOf(scene.planet);

  function disc() {
    const canvas = Object.assign(document.createElement("canvas"), { width: 128, height: 128 }), pen = canvas.getContext("2d");
    const fade = pen.createRadialGradient(64, 64, 0, 64, 64, 64);
    for (const [part, colour] of [[0, "#fffdf4"], [0.16, "#fff6d8"], [0.2, "#ffe9a866"], [1, "#ffe9a800"]]) fade.addColorStop(part, colour);
    pen.fillStyle = fade;
    pen.fillRect(0, 0, 128, 128);
    const made = new T.Sprite(new T.SpriteMaterial({ map: new T.CanvasTexture(canvas), sizeAttenuation: false,
      transparent: true, depthWrite: false }));
    made.scale.setScalar(0.14);
    root.add(made);
    return made;
  }
  const sun = scene.sun && { made: disc(), towards: array(scene.sun.towards), shadow: scene.sun.shadow && array(scene.sun.shadow) };

  const stars = (() => {
    let seed = 7;
    const random = () => ((seed = (seed * 16807) % 2147483647) / 2147483647);
    const points = new Float32Array(3 * 900), p = new T.Vector3();
    for (let k = 0; k < 900; k++) {
      const z = 2 * random() - 1, angle = 2 * Math.PI * random(), w = Math.sqrt(1 - z * z);
      p.set(w * Math.cos(angle), w * Math.sin(angle), z).multiplyScalar(4e8).toArray(points, 3 * k);
    }
    const made = new T.Points(new T.BufferGeometry().setAttribute("position", new T.BufferAttribute(points, 3)),
      new T.PointsMaterial({ color: 0xb8c7e0, size: 1.4, sizeAttenuation: false, transparent: true, opacity: 0.6 }));
    root.add(made);
    return made;
  })();

  /* rings about the origin in the plane of the orbit, with radii of 1, 2, 5 times a power of ten */
  function makeRings(size) {
    const rings = new T.Group(), power = 10 ** Math.floor(Math.log10(size));
    for (const radius of [0.1, 0.2, 0.5, 1, 2, 5].map((f) => f * power)) {
      if (radius > size || radius < size / 12) continue;
      const ring = new T.Line(shapes.points(Array.from({ length: 129 }, (_, k) =>
        new T.Vector3(radius * Math.cos((k * Math.PI) / 64), radius * Math.sin((k * Math.PI) / 64), 0))), shapes.lines(0x8aa0bd, 0.28));
      const mark = new T.Object3D();
      mark.position.set(0, -radius, 0);
      ring.add(mark);
      rings.add(ring);
      labels.add(radius >= 1000 ? `${radius / 1000} km` : `${+radius.toPrecision(1)} m`, mark, "#8aa0bd", { shown: () => !view.hidden.has("rings") });
    }
    space.add(rings);
    return rings;
  }

  const found = { planet, stars, dark: 0, towards };
  return Object.assign(found, {
    addRings(size) { found.rings = makeRings(size); },
    place(at) {
      if (planet) {
        history.vector(planet.r, at, planet.group.position);
        planet.turning.rotation.z = history.scalar(planet.turn, at);
        planet.group.visible = !view.hidden.has("planet");
      }
      if (sun) {
        if (sun.towards.length > 3) history.vector(sun.towards, at, towards); else towards.set(...sun.towards);
        towards.normalize();
        sun.made.position.copy(towards).multiplyScalar(3.5e8);
        sun.made.visible = !view.hidden.has("planet");
        towards.applyQuaternion(root.quaternion);
        found.dark = sun.shadow ? history.scalar(sun.shadow, at) : 0;
        light.intensity = 2.4 * (1 - found.dark);
        ambient.intensity = DAY + found.dark * (NIGHT - DAY);
      }
      if (found.rings) found.rings.visible = !view.hidden.has("rings");
    },
    /* directs the light from the Sun; in a scene without a Sun, the light comes from behind
     * the eye */
    shine(camera) {
      if (sun) light.position.copy(towards).multiplyScalar(1e6);
      else light.position.copy(camera.position).addScaledVector(camera.up, camera.position.length() * 0.8);
    },
  });
}
