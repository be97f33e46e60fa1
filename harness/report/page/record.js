/* Drawing of the replay with its texts on one canvas, for a PNG, a video or print. */
"use strict";
function makeRecorder(view) {
  const { scene, canvas, stage, part, history } = view;
  const sheet = document.createElement("canvas"), pen = sheet.getContext("2d");
  let recording = null, halo = "";

  function background(light, width, height) {
    const fade = pen.createRadialGradient(width / 2, height / 5, 0, width / 2, height / 5, width * 0.7);
    fade.addColorStop(0, light ? "#ffffff" : "#16233a");
    fade.addColorStop(1, light ? "#ffffff" : "#070b13");
    pen.fillStyle = fade;
    pen.fillRect(0, 0, width, height);
  }
  function write(text, x, y, size, colour, bold) {
    pen.font = `${bold ? "600 " : ""}${size}px system-ui, sans-serif`;
    Object.assign(pen, { fillStyle: colour, strokeStyle: halo, lineWidth: 3, lineJoin: "round" });
    pen.strokeText(text, x, y); /* outline, so that the text is readable in front of a planet */
    pen.fillText(text, x, y);
  }

  /* draws picture and texts, without the controls; light: on white, for print */
  function compose(light) {
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = canvas.width / (width || 1);
    if (sheet.width !== canvas.width || sheet.height !== canvas.height) Object.assign(sheet, { width: canvas.width, height: canvas.height });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    halo = light ? "#ffffff" : "#070b13";
    background(light, width, height);
    view.sky.stars.visible = !light;
    view.render();
    pen.drawImage(canvas, 0, 0, width, height);
    view.sky.stars.visible = true;
    const ink = light ? "#161b24" : "#e7ebf2", soft = light ? "#4a5563" : "#a9b6c9";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (const each of view.labels.list) {
      if (!each.at) continue;
      if (each.line) {
        Object.assign(pen, { strokeStyle: light ? soft : each.colour, lineWidth: 1 });
        pen.beginPath();
        pen.moveTo(each.from.x, each.from.y);
        pen.lineTo(each.at.x, each.at.y);
        pen.stroke();
      }
      write(each.text, each.at.x, each.at.y, 12, light ? ink : each.colour, false);
    }
    words(ink, soft, width, height);
    return sheet;
  }

  function words(ink, soft, width, height) {
    const at = history.place(view.now);
    pen.textAlign = "left";
    let y = 24;
    write(scene.title || "", 16, y, 13, soft, false);
    if (view.timeline.phase()) write(view.timeline.phase(), 16, (y += 22), 17, ink, true);
    for (const [value, name] of view.timeline.lines(at)) write(`${value} ${name}`.trim(), 16, (y += 19), 13, ink, false);
    for (const rule of view.timeline.rules)
      write(`${rule.name}: ${rule.made.children[2].textContent}`, 16, (y += 19), 13, rule.now === "violated" ? "#ff5a4d" : soft, false);
    const past = view.timeline.recent();
    write(`${view.clock.format(view.now)} s${past ? `   ${view.clock.format(past.time)} s: ${past.text}` : ""}`, 16, height - 18, 14, ink, true);
    pen.textAlign = "right";
    view.zones.list.forEach((zone, k) => write(zone.text, width - 16, height - 18 - 19 * k, 12, zone.now === VIOLATED ? "#ff5a4d" : soft, false));
  }

  function save(blob, ending) {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob),
      download: `${(scene.name || "replay").replace(/\W+/g, "_")}_${view.clock.format(view.now)}s.${ending}` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
  const picture = () => compose(false).toBlob((blob) => save(blob, "png"));

  /* ---- video: from this instant to the end, at the speed of the replay ---- */
  const TYPES = ["video/mp4;codecs=avc1", "video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"];
  const type = typeof MediaRecorder === "undefined" ? undefined : TYPES.find((t) => MediaRecorder.isTypeSupported(t));
  function video() {
    if (recording) return recording.stop();
    const pieces = [];
    compose(false);
    recording = new MediaRecorder(sheet.captureStream(30), { mimeType: type, videoBitsPerSecond: 8e6 });
    recording.addEventListener("dataavailable", (event) => pieces.push(event.data));
    recording.addEventListener("stop", () => {
      recording = null;
      view.clock.play(false);
      part(".video").setAttribute("aria-pressed", false);
      save(new Blob(pieces, { type }), type.includes("mp4") ? "mp4" : "webm");
    });
    part(".video").setAttribute("aria-pressed", true);
    recording.start(200);
    view.clock.play(true);
  }
  const ending = () => { if (recording && !view.clock.playing) setTimeout(() => recording && recording.stop(), 200); };

  /* ---- print ---- */
  const printed = document.querySelector("#replay .printed");
  function print() { if (printed && canvas.clientWidth) printed.src = compose(true).toDataURL("image/png"); }

  view.listen(part(".picture"), "click", picture);
  view.listen(part(".video"), "click", video);
  part(".video").classList.toggle("gone", !type || !canvas.captureStream);
  view.listen(window, "beforeprint", print);
  return { compose, print, after() { if (recording) { compose(false); ending(); } },
    get recording() { return !!recording; }, stage };
}
