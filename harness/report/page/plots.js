/* Plots of the page. Their cards are laid out at once, but Plotly draws a plot only when it scrolls
 * into view. All plots over time have the same time axis. */
"use strict";
const PALETTE = {
  light: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c8200"],
  dark: ["#56b4e9", "#e69f00", "#00b587", "#cc79a7", "#f0e442", "#3d8fd1", "#ff7f3f"],
};
const plotCards = [];
const linked = { range: null, time: null };

const element = (tag, cls, text) => {
  const made = document.createElement(tag);
  if (cls) made.className = cls;
  if (text !== undefined) made.textContent = text;
  return made;
};
const isDark = () => document.documentElement.dataset.theme === "dark";
const cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/* ---- layout ---- */
function layPlots(data, array) {
  for (const made of document.querySelectorAll("[data-section] .plots, #signals .component")) made.remove();
  for (const place of document.querySelectorAll("[data-section], #signals")) place.classList.remove("gone");
  plotCards.length = 0;
  linked.range = null;
  for (const section of data.figures || []) {
    const named = (name) => document.querySelector(`[data-section="${name}"]`);
    const place = named(section.name) || named("figures");
    const grid = element("div", "plots");
    for (const figure of section.figures)
      for (const plot of figure.plots)
        grid.append(card(plot, plot.title || figure.title, plot.y, array));
    place.append(grid);
  }
  for (const place of document.querySelectorAll("[data-section]"))
    if (!place.querySelector(".plot")) place.classList.add("gone");
  layComponents(data.signals || [], array);
}

function layComponents(components, array) {
  const place = document.getElementById("signals");
  if (place && !components.length) place.classList.add("gone");
  for (const component of components) {
    const box = element("details", "component");
    const head = element("summary", "", component.name);
    head.append(element("small", "",
      `${component.plots.length} changing and ${component.fixed.length} constant variables`));
    const inside = element("div");
    const grid = element("div", "plots");
    for (const plot of component.plots) grid.append(card(plot, plot.variable, plot.text, array));
    inside.append(grid, fixedValues(component.fixed));
    box.append(head, inside);
    place.append(box);
  }
}

function fixedValues(values) {
  const list = element("dl", "fixed");
  for (const value of values) {
    const row = element("div");
    const name = element("dt", "", value.variable);
    name.title = value.text;
    row.append(name, element("dd", "", `${value.value} ${value.unit}`));
    list.append(row);
  }
  return list;
}

function card(plot, title, text, array) {
  const made = element("div", "plot");
  const head = element("h4", "", title === text ? "" : title);
  const about = element("span", "", "");
  about.innerHTML = Symbols.html(text);
  about.title = text;
  const log = element("button", "", "log");
  log.type = "button";
  head.append(about, log);
  const drawing = element("div", "drawing");
  const now = element("div", "now");
  made.append(head, drawing, now);
  const entry = { plot, made, drawing, now, array, log: !!plot.log, drawn: false };
  if (!canBeLog(entry)) log.classList.add("gone");
  log.setAttribute("aria-pressed", entry.log);
  log.addEventListener("click", () => {
    entry.log = !entry.log;
    log.setAttribute("aria-pressed", entry.log);
    if (entry.drawn) draw(entry);
  });
  made.entry = entry;
  plotCards.push(entry);
  return made;
}

const canBeLog = ({ plot, array }) =>
  plot.curves.some((c) => c.y && !c.fill && array(c.y).some((value) => value > 0)) && !plot.equal;

/* ---- drawing ---- */
let seen = null;
function startPlots() {
  const again = !!seen;
  seen?.disconnect();
  seen = new IntersectionObserver((changes) => {
    for (const { target: { entry }, isIntersecting } of changes) {
      entry.visible = isIntersecting;
      if (isIntersecting && entry.stale !== "no") draw(entry);
    }
  }, { rootMargin: "300px" });
  for (const entry of plotCards) seen.observe(entry.made);
  nameRuns(window.report.data.runs);
  if (again) return;
  document.addEventListener("theme", () => { plotCards.forEach(redraw); nameRuns(window.report.data.runs); });
  document.addEventListener("replay", (event) => { linked.time = event.detail; moveCursors(); });
}

/* before printing: draws all plots that are not drawn yet, except in collapsed components */
function drawAll() {
  for (const entry of plotCards) if (entry.made.offsetParent && (!entry.drawn || entry.stale === "yes")) draw(entry);
}

/* gives every plot the present size of its card as a fixed size, until the plot is drawn again */
function fitPlots() {
  for (const { drawn, made, drawing } of plotCards)
    if (drawn && made.offsetParent) Plotly.relayout(drawing, { width: drawing.clientWidth, height: drawing.clientHeight });
}

/* draws a plot again, at once if it is in view, otherwise when it scrolls into view */
function redraw(entry) {
  entry.stale = "yes";
  if (entry.visible) draw(entry);
}

/* colour of a curve: of the palette, or, in a comparison of many runs, of a scale from the first to
 * the last run */
const colour = (which) => {
  const runs = (window.report.data.runs || []).length;
  if (typeof which === "number" && runs > 7) return scaleColour(which / (runs - 1));
  if (which === "ink") return cssColour("--ink");
  const palette = PALETTE[isDark() ? "dark" : "light"];
  return palette[which % palette.length];
};

/* cividis, a colour scale that colour-blind readers can distinguish too */
const CIVIDIS = [[0, 48, 111], [64, 78, 108], [110, 110, 114], [152, 143, 120], [200, 182, 104], [253, 231, 55]];
function scaleColour(part) {
  const at = Math.min(part, 0.9999) * (CIVIDIS.length - 1), k = Math.floor(at);
  const mixed = CIVIDIS[k].map((c, i) => Math.round(c + (at - k) * (CIVIDIS[k + 1][i] - c)));
  return `rgb(${mixed.join(",")})`;
}

function nameRuns(runs) {
  const place = document.querySelector(".runs");
  if (!place || !runs) return;
  place.replaceChildren(...runs.map((name, k) => {
    const made = element("span"), line = element("i");
    line.style.borderColor = colour(k);
    line.style.borderTopStyle = ["solid", "dashed", "dotted", "dashed", "dashed", "dashed"][k % 6];
    made.append(line, name);
    return made;
  }));
}

function trace(curve, entry) {
  if (curve.image) return image(curve, entry);
  const many = entry.plot.curves.length > 1;
  const look = { color: colour(curve.colour), width: 1.6, dash: curve.dash };
  const made = {
    type: "scatter", x: entry.array(curve.x), y: entry.array(curve.y), name: Symbols.html(curve.name),
    mode: curve.marker ? "markers" : "lines", line: look, showlegend: many && !!curve.name,
    hovertemplate: `%{y:.6g}<extra>${Symbols.html(curve.name)}</extra>`, connectgaps: false,
  };
  if (curve.fill)
    Object.assign(made, { fill: "toself", line: { ...look, width: 0.5 }, opacity: curve.opacity ?? 0.55, hoverinfo: "skip" });
  if (curve.group) Object.assign(made, { legendgroup: curve.group, showlegend: false });
  if (curve.marker)
    made.marker = { color: look.color, size: { point: 3, dot: 5 }[curve.marker] || 9,
      opacity: curve.marker === "dot" ? 0.55 : 1 };
  return made;
}


function image(curve, { array, plot }) {
  const field = array(curve.image), [rows, columns] = field.shape;
  const place = (a, b, n, k) => a + (b - a) * (k + 0.5) / n;
  const z = Array.from({ length: rows }, (_, k) => field.subarray(k * columns, (k + 1) * columns));
  if (curve.columns)
    return { type: "heatmap", colorscale: "Cividis", x: curve.columns, y: curve.rows, z, name: "",
      hovertemplate: "%{x:.6g}, %{y:.6g}: %{z:.5g}<extra></extra>" };
  const [left, right, bottom, top] = curve.edges;
  return {
    type: "heatmap", showscale: false, zmin: 0, zmax: 1, name: "", z,
    colorscale: [[0, cssColour("--card")], [1, cssColour("--accent")]],
    x: Array.from({ length: columns }, (_, k) => place(left, right, columns, k)),
    y: Array.from({ length: rows }, (_, k) => place(top, bottom, rows, k)),
    hovertemplate: "%{x:.6g}: %{z:.3g}<extra></extra>",
  };
}

function ends(entry) {
  const found = [];
  for (const curve of entry.plot.curves.filter((c) => c.ends)) {
    const x = entry.array(curve.x), y = entry.array(curve.y);
    for (const [k, symbol] of [[0, "circle"], [x.length - 1, "square"]])
      found.push({
        type: "scatter", mode: "markers", x: [x[k]], y: [y[k]], showlegend: false,
        marker: { symbol, size: 8, color: colour(curve.colour) },
        hovertemplate: `${k ? "end" : "start"}: %{x:.5g}, %{y:.5g}<extra></extra>`,
      });
  }
  return found;
}

function axis(text, log) {
  return {
    title: { text: Symbols.html(text), font: { size: 12 }, standoff: 6 }, type: log ? "log" : "linear",
    gridcolor: cssColour("--line"), zerolinecolor: cssColour("--line"),
    linecolor: cssColour("--line"), exponentformat: "power", automargin: true, nticks: 6,
    minexponent: 4,
  };
}

function layout(entry) {
  const { plot } = entry;
  const x = axis(plot.x, false), y = axis(plot.y, entry.log);
  if (plot.time && linked.range) x.range = linked.range.slice();
  if (plot.range && !entry.log) y.range = plot.range.slice();
  if (plot.range_x) x.range = plot.range_x.slice();
  if (plot.equal) Object.assign(y, { scaleanchor: "x", scaleratio: 1 });
  if (plot.ticks) Object.assign(y, { tickvals: plot.ticks[0], ticktext: plot.ticks[1] });
  if (plot.tall) x.rangemode = "tozero";
  const line = { color: cssColour("--ink"), width: 1, dash: "dash" };
  const shapes = (plot.levels || []).map(({ y: height }) =>
    ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: height, y1: height, line }));
  for (const [x0, x1] of plot.shade || [])
    shapes.push({ type: "rect", yref: "paper", y0: 0, y1: 1, x0, x1, line: { width: 0 },
      fillcolor: cssColour("--soft"), opacity: 0.14, layer: "below" });
  const annotations = (plot.shade || []).map(([x0, x1, text]) =>
    ({ x: (x0 + x1) / 2, y: 1, yref: "paper", yanchor: "top", text, showarrow: false }));
  for (const { y: height, text } of plot.levels || [])
    annotations.push({ x: 1, xref: "paper", xanchor: "right", yanchor: "bottom", text, showarrow: false,
      y: entry.log ? Math.log10(height) : height });
  for (const text of plot.notes || [])
    annotations.push({ x: 1, y: 1, xref: "paper", yref: "paper", xanchor: "right", yanchor: "top", text, showarrow: false });
  const few = plot.curves.length < 9;
  return {
    xaxis: x, yaxis: y, shapes, annotations, paper_bgcolor: "transparent",
    plot_bgcolor: "transparent", margin: { l: 56, r: 12, t: 8, b: 42 },
    font: { family: "system-ui, sans-serif", size: 11.5, color: cssColour("--soft") },
    legend: few ? { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 11 } }
      : { font: { size: 10 } },
    hovermode: plot.time ? "x unified" : "closest", dragmode: "zoom",
    hoverlabel: { bgcolor: cssColour("--card"), font: { color: cssColour("--ink") } },
  };
}

function draw(entry) {
  const traces = [...entry.plot.curves.map((curve) => trace(curve, entry)), ...ends(entry)];
  const config = { responsive: true, displaylogo: false, showSendToCloud: false, typesetMath: false, displayModeBar: matchMedia("(hover: none)").matches ? false : "hover", /* on touch screens it would always cover the plot */
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "zoomIn2d", "zoomOut2d"] };
  Plotly.react(entry.drawing, traces, layout(entry), config);
  if (!entry.drawn && entry.plot.time) link(entry);
  entry.drawn = true;
  entry.stale = "no";
  moveCursors();
}

/* ---- one time axis ---- */
function link(entry) {
  entry.drawing.on("plotly_relayout", (change) => {
    if (change["xaxis.autorange"]) zoomAll(entry, null);
    else if (change["xaxis.range"]) zoomAll(entry, change["xaxis.range"].slice());
    else if (change["xaxis.range[0]"] !== undefined)
      zoomAll(entry, [change["xaxis.range[0]"], change["xaxis.range[1]"]]);
  });
  entry.drawing.on("plotly_click", (event) => {
    window.report.show(event.points[0].x, entry.made);
  });
}

function zoomAll(source, range) {
  if (JSON.stringify(range) === JSON.stringify(linked.range)) return;
  linked.range = range;
  const change = range ? { "xaxis.range": range } : { "xaxis.autorange": true };
  for (const entry of plotCards.filter((each) => each !== source && each.plot.time)) {
    if (entry.visible && entry.drawn) Plotly.relayout(entry.drawing, { ...change });
    else entry.stale = "yes";
  }
  moveCursors();
}

function moveCursors() {
  for (const entry of plotCards) {
    const full = entry.drawn && entry.visible && entry.plot.time && entry.drawing._fullLayout;
    if (!full || linked.time === null) continue;
    const x = full.xaxis, at = x.l2p(linked.time);
    const inside = at >= 0 && at <= x._length;
    entry.now.style.display = inside ? "block" : "none";
    entry.now.style.left = `${entry.drawing.offsetLeft + x._offset + at}px`;
    entry.now.style.top = `${entry.drawing.offsetTop + full.yaxis._offset}px`;
    entry.now.style.height = `${full.yaxis._length}px`;
  }
}
