/* Start of the page: decodes numbers, unpacks libraries, starts plots and replay. */
"use strict";
(async () => {
  const json = (id) => JSON.parse(document.getElementById(id).textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  /* function that returns a stored array, given by name, as a Float32Array with .shape; the array
   * is stored as numbers or in base64 */
  const arrays = (stored) => {
    const decoded = new Map();
    return (name) => {
      if (!decoded.has(name)) {
        const { data, shape } = stored[name];
        decoded.set(name, Object.assign(typeof data === "string" ? new Float32Array(bytes(data).buffer) : data, { shape }));
      }
      return decoded.get(name);
    };
  };

  /* unpacks and runs the script of a library, which the page contains as compressed text */
  const unpack = async (name) => {
    const packed = bytes(document.getElementById(`script-${name}`).textContent);
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  };

  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = (name) => {
    root.dataset.theme = name;
    document.dispatchEvent(new Event("theme"));
  };
  theme(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => theme(dark.matches ? "dark" : "light"));
  document.getElementById("theme").addEventListener("click", () =>
    theme(root.dataset.theme === "dark" ? "light" : "dark"));

  for (const input of document.querySelectorAll(".find")) {
    const rows = document.querySelectorAll(`#${input.dataset.for} tbody tr`);
    input.addEventListener("input", () => {
      const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
      for (const row of rows) {
        const text = row.textContent.toLowerCase();
        row.classList.toggle("gone", !words.every((word) => text.includes(word)));
      }
    });
  }

  /* shows plots and replay of a run, in place of the run that was shown before */
  const present = (data, stored) => {
    const array = arrays(stored), had = window.report.replay;
    had?.dispose();
    Object.assign(window.report, { data, array, replay: null });
    for (const part of document.querySelectorAll(".has-scene")) part.classList.toggle("gone", !data.scene);
    layPlots(data, array);
    if (window.Plotly) startPlots();
    if (data.scene && window.K3D) window.report.replay = startReplay(data.scene, array, K3D.ThreeJsProvider.THREE, json("coasts").rings);
  };

  const data = json("data");
  window.report = { ready: false, present };
  present(data, json("arrays"));
  await unpack("plotly");
  startPlots();
  if (data.scene) {
    window.define = (name, needs, make) => { window.K3D = make(); };
    await unpack("k3d");
    delete window.define;
    window.report.replay = startReplay(data.scene, window.report.array, K3D.ThreeJsProvider.THREE, json("coasts").rings);
  }

  /* links from an instant in a table or plot to the replay, and back */
  window.report.show = (time, from) => {
    const { replay } = window.report;
    if (!replay) return;
    replay.play(false);
    replay.seek(time);
    document.getElementById("replay").scrollIntoView();
    const place = document.querySelector(".return");
    if (!from || !place) return;
    place.classList.remove("gone");
    place.onclick = () => { from.scrollIntoView({ block: "center" }); place.classList.add("gone"); };
  };
  for (const button of document.querySelectorAll(".seek")) {
    if (!window.report.replay) button.remove();
    button.addEventListener("click", () => window.report.show(Number(button.dataset.time), button));
  }

  /* Printing uses the light theme, draws all plots, and sets the width of the paper. Plotly does
   * not notice the new width, so the plots are resized explicitly. */
  let before = "";
  window.addEventListener("beforeprint", () => {
    before = root.dataset.theme;
    theme("light");
    for (const each of document.querySelectorAll("details.settings")) each.open = true;
    root.classList.add("paper");
    drawAll();
    fitPlots();
  });
  window.addEventListener("afterprint", () => { root.classList.remove("paper"); theme(before); });
  window.report.ready = true;
  document.dispatchEvent(new Event("ready"));
})();
