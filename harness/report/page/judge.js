/* Requirements over the rows of a flight: the verdicts of harness/results/requirements.py, from trees
 * that were written when the page was made (harness/report/conditions.py). */
"use strict";
const Judge = (() => {
  const F = typeof require === "function" ? require("./flight.js") : Flight;
  const { map, make, scalar, reduce, UFUNCS } = F;
  const all = (values, test) => { for (const v of values) if (!test(v)) return false; return true; };

  /* ---- values ---- */
  const OPERATORS = {
    "+": UFUNCS.add, "-": UFUNCS.subtract, "*": UFUNCS.multiply, "/": UFUNCS.divide, "**": UFUNCS.power,
    "<": UFUNCS.less, "<=": UFUNCS.less_equal, ">": UFUNCS.greater, ">=": UFUNCS.greater_equal,
    "==": UFUNCS.equal, "!=": UFUNCS.not_equal, and: UFUNCS.logical_and, or: UFUNCS.logical_or,
  };
  const lengths = (x) => map(Math.sqrt, reduce(UFUNCS.add, map(UFUNCS.square, x), -1));
  const mean = (x) => reduce(UFUNCS.add, x).data[0] / x.data.length;
  const angle = (q, p) => {
    const [a, b] = [lengths(map(UFUNCS.subtract, q, p)), lengths(map(UFUNCS.add, q, p))];
    return map((x, y) => 4 * Math.atan2(Math.min(x, y), Math.max(x, y)), a, b);
  };
  const percentile = (x, part) => {
    const sorted = Float64Array.from(x.data).sort(), at = (part.data[0] / 100) * (sorted.length - 1);
    const low = Math.floor(at), high = Math.min(low + 1, sorted.length - 1);
    if (all(sorted, (v) => v === v)) return scalar(sorted[low] + (at - low) * (sorted[high] - sorted[low]));
    return scalar(NaN);
  };
  const settling = (time, error, band) => {
    let outside = -1;
    error.data.forEach((e, k) => { if (!(e <= band.data[0])) outside = k; });
    return scalar(outside + 1 < time.data.length ? time.data[outside + 1] - time.data[0] : NaN);
  };
  const steady = (time, error) => {
    const t = time.data, from = t[t.length - 1] - 0.2 * (t[t.length - 1] - t[0]);
    return scalar(error.data.reduce((most, e, k) => (t[k] >= from ? F.most(most, e) : most), -Infinity));
  };
  const FUNCTIONS = {
    abs: (x) => map(Math.abs, x), angle, cos: (x) => map(Math.cos, x), degrees: (x) => map(UFUNCS.degrees, x),
    exp: (x) => map(Math.exp, x), first: (x) => F.pick(x, [{ i: 0 }]), last: (x) => F.pick(x, [{ i: -1 }]),
    log: (x) => map(Math.log, x), max: (x) => reduce(F.most, x), mean: (x) => scalar(mean(x)), min: (x) => reduce(F.least, x),
    norm: lengths, percentile, rms: (x) => scalar(Math.sqrt(mean(map(UFUNCS.square, x)))), settling_time: settling,
    sin: (x) => map(Math.sin, x), sqrt: (x) => map(Math.sqrt, x),
    std: (x) => { const m = mean(x); return scalar(Math.sqrt(mean(map((v) => (v - m) ** 2, x)))); },
    steady, total: (x) => reduce(UFUNCS.add, x, -1),
  };

  /* ---- conditions over windows of time (harness/results/margins.py) ---- */
  const lower = (values, x, from = 0) => { let a = from, b = values.length; while (a < b) { const m = (a + b) >> 1; if (values[m] < x) a = m + 1; else b = m; } return a; };
  const upper = (values, x) => { let a = 0, b = values.length; while (a < b) { const m = (a + b) >> 1; if (values[m] <= x) a = m + 1; else b = m; } return a; };
  const windows = (time, begin, end, complete) => {
    const n = time.length, slack = 1e-9 * Math.max(1, time.reduce((a, t) => Math.max(a, Math.abs(t)), 0));
    const first = Array.from(time, (t) => lower(time, t + (begin - slack)));
    if (end === null) return { first, last: first.map(() => n - 1), over: first.map((k) => k < n && complete) };
    const last = Array.from(time, (t) => upper(time, t + (end + slack)) - 1);
    return { first, last, over: Array.from(time, (t, k) => t + (end - slack) <= time[n - 1] && first[k] <= last[k]) };
  };
  const eventually = (x, { first, last, over }) => {
    const level = first.map((a, k) => Math.floor(Math.log2(Math.max(1, last[k] - a + 1))));
    const found = new Float64Array(x.length).fill(NaN);
    let table = x;
    for (let l = 0, top = Math.max(...[0], level.reduce((a, b) => Math.max(a, b), 0)); l <= top; l++) {
      const long = 2 ** l;
      for (let k = 0; k < x.length; k++)
        if (over[k] && level[k] === l) found[k] = UFUNCS.fmax(table[first[k]], table[last[k] + 1 - long]);
      const next = new Float64Array(Math.max(0, table.length - long));
      for (let k = 0; k < next.length; k++) next[k] = UFUNCS.fmax(table[k], table[k + long]);
      table = next;
    }
    return found;
  };
  const minus = (x) => x.map((v) => -v);
  const after = (x1, y1, x2, y2) => [UFUNCS.fmin(x1, x2), UFUNCS.fmax(y1, x1 !== x1 ? y2 : F.least(x1, y2))];
  const composed = (x, y, begin, length) => {
    const n = x.length, least = new Float64Array(n).fill(NaN), witness = new Float64Array(n).fill(NaN), place = begin.slice();
    let a = x, b = y;
    for (let level = 0, top = length.reduce((m, v) => Math.max(m, v), 0); 2 ** level <= top; level++) {
      const long = 2 ** level;
      for (let k = 0; k < n; k++) {
        if (!(length[k] > 0 && Math.floor(length[k] / long) % 2)) continue;
        [least[k], witness[k]] = after(least[k], witness[k], a[place[k]], b[place[k]]);
        place[k] += long;
      }
      const m = Math.max(0, a.length - long), next = [new Float64Array(m), new Float64Array(m)];
      for (let k = 0; k < m; k++) [next[0][k], next[1][k]] = after(a[k], b[k], a[k + long], b[k + long]);
      [a, b] = next;
    }
    return [least, witness];
  };
  const until = (x, y, { first, last, over }) => {
    const n = x.length, begin = Array.from(x, (_, k) => k);
    const [held] = composed(x, y, begin, begin.map((k) => Math.min(first[k], n) - k));
    const [, witness] = composed(x, y, first, first.map((a, k) => last[k] + 1 - a));
    return Float64Array.from(witness, (w, k) => {
      const found = held[k] !== held[k] ? w : F.least(held[k], w);
      return over[k] || found >= 0 ? found : NaN;
    });
  };
  const WINDOWS = {
    always: (w, x) => minus(eventually(minus(x), w)), eventually: (w, x) => eventually(x, w), until: (w, x, y) => until(x, y, w),
  };

  /* ---- margins (harness/results/margins.py) ---- */
  const SIGNED = { "<": (d) => -d, "<=": (d) => -d, ">": (d) => d, ">=": (d) => d, "==": (d) => -Math.abs(d), "!=": Math.abs };
  const argmin = (values) => {
    let at = 0;
    for (let k = 0; k < values.length; k++) {
      if (values[k] !== values[k]) return k;
      if (values[k] < values[at]) at = k;
    }
    return at;
  };
  const argmax = (values) => argmin(Array.from(values, (v) => -v));

  /* flight: time, complete, column(name) and parameter(name) as arrays */
  class Margins {
    constructor(flight, guarded) { Object.assign(this, { flight, guarded, undecided: false, known: new Map() }); }

    value(node) {
      switch (node.kind) {
        case "number": return scalar(node.value === null ? Infinity : node.value);
        case "name": return node.name === "time" ? make([this.rows], this.flight.time) : this.flight.column(node.name);
        case "parameter": return this.flight.parameter(node.name);
        case "operator": return node.parts.map((p) => this.value(p)).reduce((a, b) => map(OPERATORS[node.name], a, b));
        case "negative": return map(UFUNCS.negative, this.value(node.parts[0]));
        case "positive": return this.value(node.parts[0]);
        case "not": return map(UFUNCS.logical_not, this.value(node.parts[0]));
        case "call": return FUNCTIONS[node.name](...node.parts.map((p) => this.value(p)));
        case "pick": return F.pick(this.value(node.parts[0]), node.index);
        default: throw new Error(`${node.kind} is no number`);
      }
    }

    get rows() { return this.flight.time.length; }
    sides(node) {
      if (!this.known.has(node)) this.known.set(node, node.parts.map((p) => this.value(p)));
      return this.known.get(node);
    }

    rowsOf({ shape, data }) {
      const history = shape.length > 0 && shape[0] === this.rows;
      const n = history ? this.rows : 1;
      return { n, width: data.length / n, data, at(row) { const k = n > 1 ? row : 0; return data.subarray(k * this.width, (k + 1) * this.width); } };
    }

    truth(node) {
      if (node.compare) return map((a, b) => (a !== a || b !== b ? NaN : OPERATORS[node.name](a, b)), ...this.sides(node));
      if (node.kind === "not") return map((x) => 1 - x, this.truth(node.parts[0]));
      if (node.joins) {
        const [decides, extreme] = node.name === "or" ? [1, F.most] : [0, F.least];
        return node.parts.map((p) => this.truth(p)).reduce((a, b) => map((x, y) => (x === decides || y === decides ? decides : extreme(x, y)), a, b));
      }
      return map((v) => (v !== v ? NaN : +(v !== 0)), this.value(node));
    }

    holds(node) {
      const found = this.rowsOf(this.truth(node));
      return Float64Array.from({ length: found.n }, (_, k) => +all(found.at(k), (v) => v === 1));
    }

    elements(node) {
      const [a, b] = this.sides(node);
      return this.rowsOf(map((x, y) => SIGNED[node.name](x - y), a, b));
    }

    of(node) {
      let found;
      if (this.guarded && node.timing) found = this.holds(node).map((v) => (v ? Infinity : -Infinity));
      else if (node.compare) {
        const e = this.elements(node);
        found = Float64Array.from({ length: e.n }, (_, k) => e.at(k).reduce(F.least));
      } else if (node.kind === "not") found = minus(this.of(node.parts[0]));
      else if (node.joins) {
        const parts = node.parts.map((p) => this.of(p)), n = Math.max(...parts.map((p) => p.length));
        const extreme = node.name === "or" ? F.most : F.least;
        found = Float64Array.from({ length: n }, (_, k) => parts.map((p) => p[p.length > 1 ? k : 0]).reduce(extreme));
      } else found = this.holds(node).map((v) => (v ? 1 : -1));
      return found.map((v) => (v !== v ? -Infinity : v));
    }

    exercised(node, looked = null, negated = false) {
      if (node.timing) return !this.guarded;
      if (node.kind === "not") return this.exercised(node.parts[0], looked, !negated);
      if (node.joins) {
        const decides = node.name === "or" ? 1 : 0;
        const further = node.parts.filter((p) => !p.timing);
        if (Boolean(decides) === negated) return further.every((p) => this.exercised(p, looked, negated));
        for (const part of node.parts.filter((p) => p.timing)) {
          const truth = this.rowsOf(this.truth(part)), before = looked;
          looked = Array.from({ length: this.rows }, (_, k) => (before ? before[k] : true) && !all(truth.at(k), (v) => v === decides));
        }
        return further.some((p) => this.exercised(p, looked, negated));
      }
      return looked ? looked.some(Boolean) : true;
    }

    decisive(node, row) {
      if (node.kind === "not") return this.decisive(node.parts[0], row);
      if (!node.joins) return node;
      const margins = node.parts.map((p) => { const m = this.of(p); return m[m.length > 1 ? row : 0]; });
      return this.decisive(node.parts[node.name === "or" ? argmax(margins) : argmin(margins)], row);
    }

    shown(node, row) {
      const element = node.compare ? argmin(this.elements(node).at(row)) : 0;
      const found = this.rowsOf(node.compare ? this.sides(node)[node.shown] : this.value(node)).at(row);
      const value = found[Math.min(element, found.length - 1)];
      return node.factor === undefined ? value : node.factor * value + node.offset;
    }

    over(node) {
      if (node.kind === "not" && node.windowed) return this.over(node.parts[0]).map(minus);
      if (node.joins && node.windowed) return this.combined(node.parts.map((p) => this.over(p)), node.name === "or");
      if (node.kind === "window") {
        const within = windows(this.flight.time, node.begin, node.end, this.flight.complete);
        const pairs = node.parts.map((p) => this.over(p));
        return [0, 1].map((k) => WINDOWS[node.name](within, ...pairs.map((pair) => pair[k])));
      }
      const truth = this.rowsOf(this.truth(node)), margin = this.of(node), holds = this.holds(node), one = (v) => (k) => v[v.length > 1 ? k : 0];
      this.undecided ||= !all(truth.data, (v) => v === v);
      return [Float64Array.from({ length: this.rows }, (_, k) => one(margin)(k)), Float64Array.from({ length: this.rows }, (_, k) => (one(holds)(k) ? 1 : -1))];
    }

    combined(pairs, largest) {
      const [extreme, decides] = largest ? [UFUNCS.fmax, 1] : [UFUNCS.fmin, -1];
      const both = [0, 1].map((i) => Float64Array.from({ length: this.rows }, (_, k) => pairs.map((p) => p[i][k]).reduce(extreme)));
      both[1].forEach((sign, k) => {
        if (pairs.some((p) => p[1][k] !== p[1][k]) && sign !== decides) both[0][k] = both[1][k] = NaN;
      });
      return both;
    }
  }

  /* ---- verdicts ---- */
  const WORDS = { good: "met", bad: "not met", idle: "not exercised", none: "not judged" };
  const told = (kind, detail, time = null, margin = null) => ({ kind, verdict: WORDS[kind], detail, time, margin });
  const unitText = (unit) => (unit || "").replace(/^1/, "");

  const early = (flight) => told("bad", `the run ended early, at ${g(flight.time.at(-1))} s`, null, -Infinity);
  const atStart = (flight, { tree, marginUnit }) => {
    const margins = new Margins(flight, !tree.timing), [margin, sign] = margins.over(tree).map((each) => each[0]);
    if (margins.undecided) return told("bad", "not a number", null, -Infinity);
    if (sign !== sign && !flight.complete) return early(flight);
    if (sign !== sign) return told("idle", `the run ends at ${g(flight.time.at(-1))} s, before its window is over`);
    return told(sign > 0 ? "good" : "bad", `margin ${g(margin + 0)} ${unitText(marginUnit)}`.trimEnd(), null, margin);
  };
  const everywhere = (flight, { tree }) => {
    const margins = new Margins(flight, !tree.timing), truth = margins.truth(tree), met = all(truth.data, (v) => v === 1);
    if (met && !margins.exercised(tree)) return told("idle", `the run ends at ${g(flight.time.at(-1))} s, before it applies`);
    const rows = margins.rowsOf(truth), of = margins.of(tree), n = Math.max(rows.n, of.length);
    const undecided = Array.from({ length: n }, (_, k) => !all(rows.at(k), (v) => v === v));
    const least = Float64Array.from({ length: n }, (_, k) => (undecided[k] ? -Infinity : of[of.length > 1 ? k : 0]));
    const some = undecided.some(Boolean), row = some ? undecided.indexOf(true) : argmin(least);
    const decisive = margins.decisive(tree, row), value = some ? NaN : margins.shown(decisive, row);
    const time = n === flight.time.length ? flight.time[row] : null, place = time === null ? "" : ` at ${g(time)} s`;
    const detail = value !== value ? `not a number${place}` : `worst ${g(value)} ${unitText(decisive.unit)}`.trimEnd() + place;
    return told(met ? "good" : "bad", detail, time, least[row]);
  };

  /* one requirement of a flight */
  const judged = (flight, requirement) => {
    if (requirement.refused) return told("none", requirement.refused);
    try {
      if (requirement.tree.windowed) return atStart(flight, requirement);
      const found = everywhere(flight, requirement);
      if (flight.complete) return found;
      return found.kind === "bad" ? { ...found, margin: -Infinity } : early(flight);
    } catch (error) { return told("none", error.message); }
  };

  /* a number as %.6g writes it */
  const g = (x, digits = 6) => {
    if (x !== x) return "nan";
    if (!Number.isFinite(x)) return x > 0 ? "inf" : "-inf";
    if (x === 0) return Object.is(x, -0) ? "-0" : "0";
    const [mantissa, power] = x.toExponential(digits - 1).split("e"), p = Number(power);
    const short = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
    if (p >= -4 && p < digits) return short(x.toFixed(digits - 1 - p));
    return `${short(mantissa)}e${p < 0 ? "-" : "+"}${String(Math.abs(p)).padStart(2, "0")}`;
  };

  return { judged, g, FUNCTIONS, OPERATORS, WINDOWS };
})();
if (typeof require === "function") module.exports = Judge;
