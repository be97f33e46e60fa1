/* Evaluation of instructions on the rows of a run: values of expressions, with the same bits as
 * harness/results/program.py, and verdicts on requirements, as in harness/results/requirements.py.
 *
 * A value is a table {n, m, data} with n rows of m elements; n is 1 for a value that is the same in
 * all rows. */
"use strict";
const Program = (() => {
  const table = (n, m, data = new Float64Array(n * m)) => ({ n, m, data });
  const scalar = (value) => table(1, 1, Float64Array.of(value));
  const common = (sizes, what) => {
    const size = sizes.find((k) => k !== 1) ?? 1;
    if (sizes.some((k) => k !== 1 && k !== size)) throw new Error(`numbers of ${what} differ: ${sizes.join(", ")}`);
    return size;
  };
  /* applies f to tables element by element; a table with one row or one element per row is combined
   * with all rows or elements of the other tables */
  const map = (f, ...of) => {
    const n = common(of.map((x) => x.n), "rows"), m = common(of.map((x) => x.m), "elements"), out = table(n, m);
    const [a, b, c] = of.map(({ data, n: rows, m: width }) => {
      if (rows === n && width === m) return data;
      return Float64Array.from({ length: n * m }, (_, i) => data[(rows > 1 ? Math.floor(i / m) * width : 0) + (width > 1 ? i % m : 0)]);
    });
    for (let i = 0; i < n * m; i++) out.data[i] = f(a[i], b && b[i], c && c[i]);
    return out;
  };
  const byRow = (f, x) => table(x.n, 1, Float64Array.from({ length: x.n }, (_, k) => f(x.data.subarray(k * x.m, (k + 1) * x.m))));
  const row = (x, k) => table(1, x.m, x.data.slice(k * x.m, (k + 1) * x.m));

  /* ---- numbers ---- */
  const least = (a, b) => (a !== a || b !== b ? NaN : a < b ? a : b), largest = (a, b) => (a !== a || b !== b ? NaN : a > b ? a : b);
  const fmin = (a, b) => (a !== a ? b : b !== b ? a : a < b ? a : b), fmax = (a, b) => (a !== a ? b : b !== b ? a : a > b ? a : b);
  const decided = (x, a, b) => (a !== a || (b !== undefined && b !== b) ? NaN : x);
  const power = (a, b) => (a === 1 || b === 0 ? 1 : b === 2 ? a * a : b === 0.5 ? Math.sqrt(a) : b === -1 ? 1 / a : a ** b);
  /* sum in the order in which numpy adds, for equal bits: eight partial sums; more than 128 numbers
   * are divided into halves */
  const sum = (x) => {
    const n = x.length;
    if (n < 8) return x.reduce((a, b) => a + b, 0);
    if (n > 128) {
      const half = Math.floor(n / 2), first = half - (half % 8);
      return sum(x.subarray(0, first)) + sum(x.subarray(first));
    }
    const r = x.slice(0, 8), end = n - (n % 8);
    for (let i = 8; i < end; i++) r[i % 8] += x[i];
    return x.subarray(end).reduce((a, b) => a + b, ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7])));
  };
  const mean = ({ data }) => sum(data) / data.length;
  const square = (x) => map((v) => v * v, x);
  const norm = (x) => map(Math.sqrt, byRow(sum, square(x)));
  const lower = (values, x) => { let a = 0, b = values.length; while (a < b) { const k = (a + b) >> 1; if (values[k] < x) a = k + 1; else b = k; } return a; };
  const upper = (values, x) => { let a = 0, b = values.length; while (a < b) { const k = (a + b) >> 1; if (values[k] <= x) a = k + 1; else b = k; } return a; };
  const slackOf = (time) => 1e-9 * time.reduce((a, t) => Math.max(a, Math.abs(t)), 1);

  const EACH = {
    "+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b, "**": power,
    "<": (a, b) => +(a < b), "<=": (a, b) => +(a <= b), ">": (a, b) => +(a > b), ">=": (a, b) => +(a >= b),
    "==": (a, b) => +(a === b), "!=": (a, b) => +(a !== b), and: (a, b) => +(a !== 0 && b !== 0), or: (a, b) => +(a !== 0 || b !== 0),
    not: (a) => +(a === 0), implies: (a) => +(a === 0), negative: (a) => -a, positive: (a) => a,
    abs: Math.abs, cos: Math.cos, degrees: (a) => a * (180 / Math.PI), exp: Math.exp, log: Math.log, sin: Math.sin, sqrt: Math.sqrt,
    decided, both: (a, b) => (a === 0 || b === 0 ? 0 : a * b), where: (c, a, b) => (c !== 0 ? a : b),
    difference: (a, b) => (a === b ? 0 : a - b), fmin, fmax, isnan: (a) => +(a !== a),
  };

  /* ---- functions of whole tables ---- */
  const percentile = ({ data }, { data: [percent] }) => {
    const sorted = Float64Array.from(data).sort(), at = (percent / 100) * (sorted.length - 1), low = Math.floor(at), part = at - low;
    if (sorted.some((v) => v !== v)) return scalar(NaN);
    const a = sorted[low], b = sorted[Math.min(low + 1, sorted.length - 1)];
    return scalar(part < 0.5 ? a + (b - a) * part : b - (b - a) * (1 - part));
  };
  const settling = ({ data: time }, { data: error }, { data: [band] }) => {
    let outside = -1;
    error.forEach((e, k) => { if (!(e <= band)) outside = k; });
    return scalar(outside + 1 < time.length ? time[outside + 1] - time[0] : NaN);
  };
  const steady = ({ data: time }, { m, data: error }) => {
    const end = time[time.length - 1], from = end - 0.2 * (end - time[0]);
    return scalar(error.reduce((most, e, k) => (time[Math.floor(k / m)] >= from ? largest(most, e) : most), -Infinity));
  };
  const at = ({ data: [instant] }, { data: time }) => {
    const slack = slackOf(time), [begin, end] = [time[0], time[time.length - 1]];
    if (!(begin - slack <= instant && instant <= end + slack)) throw new Error(`at(): expected a time from ${g(begin)} to ${g(end)} s, got ${g(instant)} s`);
    return scalar(Math.max(0, upper(time, instant + slack) - 1));
  };
  const angle = (q, p) => map((x, y) => 4 * Math.atan2(Math.min(x, y), Math.max(x, y)), norm(map(EACH["-"], q, p)), norm(map(EACH["+"], q, p)));
  const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
  const unit = (v) => { const long = Math.sqrt(sum(Float64Array.from(v, (x) => x * x))); return v.map((x) => x / long); };
  /* quaternion (scalar first) of the Hill frame with the axes r, (r x v) x r, r x v, in each row */
  const hill = (r, v) => {
    const out = table(Math.max(r.n, v.n), 4);
    for (let k = 0; k < out.n; k++) {
      const [x, y] = [r, v].map(({ n, data }) => Array.from(data.subarray(n > 1 ? 3 * k : 0, (n > 1 ? 3 * k : 0) + 3))), normal = cross(x, y);
      const [[a, d, g_], [b, e, h], [c, f, i]] = [x, cross(normal, x), normal].map(unit);
      const rows = [[1 + a + e + i, h - f, c - g_, d - b], [h - f, 1 + a - e - i, b + d, c + g_], [c - g_, b + d, 1 - a + e - i, f + h], [d - b, c + g_, f + h, 1 - a - e + i]];
      out.data.set(unit(rows[rows.reduce((best, q, j) => (q[j] > rows[best][best] ? j : best), 0)]), 4 * k);
    }
    return out;
  };
  /* function on tables that applies f to each row; f returns a row of m elements */
  const perRow = (m, f) => (...parts) => {
    const given = parts.filter((x) => x); /* the constant of the instruction is null here and left out */
    const out = table(Math.max(...given.map((x) => x.n)), m);
    for (let k = 0; k < out.n; k++) {
      out.data.set(f(...given.map((x) => Array.from(x.data.subarray(x.n > 1 ? x.m * k : 0, (x.n > 1 ? x.m * k : 0) + x.m)))), m * k);
    }
    return out;
  };
  const dot = (u, v) => sum(Float64Array.from(u, (x, k) => x * v[k]));
  const mrp = perRow(4, (s) => [1 - dot(s, s), ...s.map((x) => 2 * x)].map((x) => x / (1 + dot(s, s))));
  const turned = perRow(3, ([w, ...u], v) => { const t = cross(u, v).map((x) => 2 * x), c = cross(u, t); return v.map((x, k) => x + w * t[k] + c[k]); });
  const between = perRow(1, (u, v) => { const c = cross(u, v); return [Math.atan2(Math.sqrt(dot(c, c)), dot(u, v))]; });
  const orbit = perRow(4, ([i], [w], [o], [n]) => {
    const h = i / 2, a = (o + w + n) / 2, b = (o - w - n) / 2;
    return [Math.cos(h) * Math.cos(a), Math.sin(h) * Math.cos(b), Math.sin(h) * Math.sin(b), Math.cos(h) * Math.sin(a)];
  });
  const shifted = (by) => (x) => {
    const out = table(x.n, x.m);
    for (let k = 0; k < x.n; k++) out.data.set(row(x, Math.min(x.n - 1, Math.max(0, k + by))).data, k * x.m);
    return out;
  };
  const element = (x, [k, text]) => {
    if (k >= x.m) throw new Error(`\`${text}\` has ${x.m} elements`);
    return table(x.n, 1, Float64Array.from({ length: x.n }, (_, i) => x.data[i * x.m + k]));
  };
  const WHOLE = {
    angle, angle_between: between, at, element, mrp, orbit, turned, first: () => scalar(0), hill, last: () => scalar(-1), max: ({ data }) => scalar(data.reduce(largest)),
    mean: (x) => scalar(mean(x)), min: ({ data }) => scalar(data.reduce(least)), next: shifted(1), norm, number: (constant) => scalar(Number(constant)), percentile, previous: shifted(-1),
    rms: (x) => scalar(Math.sqrt(mean(square(x)))), settling_time: settling,
    std: (x) => { const middle = mean(x); return scalar(Math.sqrt(mean(map((v) => (v - middle) ** 2, x)))); },
    steady, sum: ({ data }) => scalar(sum(data)), total: (x) => byRow(sum, x), table: (x) => x, any: ({ data }) => scalar(+data.some((v) => v !== 0)),
    least: (x) => byRow((elements) => elements.reduce(least), x),
    row: (x, { data: [k] }) => row(x, k < 0 ? x.n + k : k), "one row": (x, { data: [k] }) => row(x, k < 0 ? x.n + k : k),
    "every row": (x, time) => map((a) => a, x, table(time.n, 1)),
  };

  /* ---- windows of time (harness/results/windows.py) ---- */
  const windows = (time, begin, end, complete) => {
    const n = time.length, slack = slackOf(time), first = Array.from(time, (t) => lower(time, t + (begin - slack)));
    if (end === Infinity) return { first, last: first.map(() => n - 1), over: first.map((k) => k < n && complete) };
    const last = Array.from(time, (t) => upper(time, t + (end + slack)) - 1);
    return { first, last, over: Array.from(time, (t, k) => t + (end - slack) <= time[n - 1] && first[k] <= last[k]) };
  };
  const levelOf = (length) => Math.floor(Math.log2(Math.max(1, length)));
  const eventually = ({ first, last, over }, x) => {
    const level = first.map((a, k) => levelOf(last[k] - a + 1)), top = level.reduce((a, b) => Math.max(a, b), 0);
    const found = new Float64Array(x.length).fill(NaN);
    for (let l = 0, blocks = x; l <= top; l++) {
      const long = 2 ** l;
      for (let k = 0; k < x.length; k++) if (over[k] && level[k] === l) found[k] = fmax(blocks[first[k]], blocks[last[k] + 1 - long]);
      blocks = Float64Array.from({ length: Math.max(0, blocks.length - long) }, (_, k) => fmax(blocks[k], blocks[k + long]));
    }
    return found;
  };
  const always = (within, x) => eventually(within, x.map((v) => -v)).map((v) => -v);
  const after = (x1, y1, x2, y2) => [fmin(x1, x2), fmax(y1, x1 !== x1 ? y2 : least(x1, y2))];
  const composed = (x, y, begin, length) => {
    const n = x.length, low = new Float64Array(n).fill(NaN), witness = new Float64Array(n).fill(NaN), place = begin.slice();
    let [a, b] = [x, y];
    for (let l = 0, top = length.reduce((m, v) => Math.max(m, v), 0); 2 ** l <= top; l++) {
      const long = 2 ** l, m = Math.max(0, a.length - long), next = [new Float64Array(m), new Float64Array(m)];
      for (let k = 0; k < n; k++) {
        if (!(length[k] > 0 && Math.floor(length[k] / long) % 2)) continue;
        [low[k], witness[k]] = after(low[k], witness[k], a[place[k]], b[place[k]]);
        place[k] += long;
      }
      for (let k = 0; k < m; k++) [next[0][k], next[1][k]] = after(a[k], b[k], a[k + long], b[k + long]);
      [a, b] = next;
    }
    return [low, witness];
  };
  const until = ({ first, last, over }, x, y) => {
    const n = x.length, begin = Array.from(x, (_, k) => k), [held] = composed(x, y, begin, begin.map((k) => Math.min(first[k], n) - k));
    const [, witness] = composed(x, y, first, first.map((a, k) => last[k] + 1 - a));
    return witness.map((w, k) => {
      const found = held[k] !== held[k] ? w : least(held[k], w);
      return over[k] || found >= 0 ? found : NaN;
    });
  };
  const empty = ({ first, last }, time, end) => Float64Array.from(time, (t, k) => +(first[k] > last[k] && t + end <= time[time.length - 1]));
  const WINDOWED = { always, eventually, until };

  /* values of a table in the given rows; or, by the reduction `over`, the mean, smallest or largest
   * value from each given row up to the next given row */
  const REDUCED = { mean: (x) => sum(x) / x.length, least: (x) => x.reduce(least), largest: (x) => x.reduce(largest) };
  const sample = (x, over, rows) => {
    const out = table(rows.length, x.m);
    rows.forEach((first, i) => {
      const last = over === "row" ? first + 1 : rows[i + 1] ?? x.n, values = x.data.subarray(first * x.m, last * x.m);
      if (over === "row") out.data.set(values, i * x.m);
      else for (let k = 0; k < x.m; k++) out.data[i * x.m + k] = REDUCED[over](values.filter((_, j) => j % x.m === k));
    });
    return out;
  };

  /* Returns the function value(k), which computes the value of instruction k for a run. run: object
   * with time, complete and lookUp(name). */
  const evaluator = (instructions, run) => {
    const known = new Map();
    const compute = ([operation, parts, constant]) => {
      if (operation === "look up") return run.lookUp(constant);
      if (operation === "number") return WHOLE.number(constant);
      const of = parts.map(value);
      if (EACH[operation]) return operation === "decided" && of.length > 3 ? of.slice(1).reduce((x, by) => map(decided, x, by), of[0]) : map(EACH[operation], ...of);
      if (operation === "empty" || WINDOWED[operation]) {
        const [begin, end] = constant.map(Number), { data: time } = of.at(-1), within = windows(time, begin, end, run.complete);
        return table(time.length, 1, operation === "empty" ? empty(within, time, end) : WINDOWED[operation](within, ...of.slice(0, -1).map((x) => x.data)));
      }
      if (!WHOLE[operation]) throw new Error(`the page has no operation ${operation}`);
      return WHOLE[operation](...of, constant);
    };
    const value = (k) => {
      if (!known.has(k)) known.set(k, compute(instructions[k]));
      return known.get(k);
    };
    return value;
  };

  /* ---- verdicts (harness/results/requirements.py) ---- */
  const WORDS = { good: "met", bad: "not met", idle: "not exercised", none: "not judged" };
  const verdict = (kind, detail, time = null, margin = null) => ({ kind, verdict: WORDS[kind], detail, time, margin });
  const withUnit = (text, name) => `${text} ${name.replace(/^1/, "")}`.trimEnd();
  const firstOf = (values, test) => values.findIndex((v) => test(v));
  const argmin = (values) => { const gap = firstOf(values, (v) => v !== v); return gap >= 0 ? gap : values.reduce((best, v, k) => (v < values[best] ? k : best), 0); };
  const early = (run) => verdict("bad", `the run ended early, at ${g(run.time.at(-1))} s`, null, -Infinity);

  const atStart = (run, value, required) => {
    const [margin, sign] = [required.margin, required.truth].map((k) => value(k).data[0]), end = g(run.time.at(-1));
    if (value(required.undecided).data[0]) return verdict("bad", "not a number", null, -Infinity);
    if (sign !== sign && !run.complete) return early(run);
    const window = required.empty.filter(([, k]) => value(k).data[0]).at(-1);
    if (sign !== sign) return verdict("idle", window ? `no recorded row lies in a window of ${window[0]}` : `the run ends at ${end} s, before its window is over`);
    return verdict(sign > 0 ? "good" : "bad", withUnit(`margin ${g(margin + 0)}`, required.marginUnit), null, margin);
  };
  const inEveryRow = (run, value, required) => {
    const truth = value(required.truth), margin = value(required.margin).data, met = truth.data.every((v) => v === 1);
    if (met && !value(required.exercised).data[0]) return verdict("idle", `it does not apply up to the end at ${g(run.time.at(-1))} s`);
    const gap = firstOf(truth.data, (v) => v !== v), k = gap >= 0 ? Math.floor(gap / truth.m) : argmin(margin);
    const time = required.has_rows ? run.time[k] : null, place = time === null ? "" : ` at ${g(time)} s`;
    if (gap >= 0) return verdict("bad", `not a number${place}`, time, margin[k]);
    const { data } = row(value(required.elements), k), i = argmin(data);
    const [found, which] = [required.value, required.which].map((number) => { const x = value(number); return x.data[(x.n > 1 ? k * x.m : 0) + (x.m > 1 ? i : 0)]; });
    const { unit: name, factor, offset } = required.units[which];
    const shown = factor * found + offset, metres = Math.abs(shown) >= 1000 && { cm: 0.01, mm: 0.001 }[name];
    const worst = metres ? withUnit(`worst ${g(metres * shown)}`, "m") : withUnit(`worst ${g(shown)}`, name);
    return verdict(met ? "good" : "bad", worst + place, time, margin[k]);
  };

  /* verdict on one requirement in a run; value(k): value of instruction k */
  const verdictOf = (run, value, required) => {
    if (required.rejected) return verdict("none", required.rejected);
    try {
      if (required.at_start) return atStart(run, value, required);
      const found = inEveryRow(run, value, required);
      if (run.complete) return found;
      return found.kind === "bad" ? { ...found, margin: -Infinity } : early(run);
    } catch (error) { return verdict("none", error.message); }
  };

  /* a number as text, in the format %.6g of C */
  const g = (x, digits = 6) => {
    if (x !== x) return "nan";
    if (!Number.isFinite(x)) return x > 0 ? "inf" : "-inf";
    if (x === 0) return Object.is(x, -0) ? "-0" : "0";
    const [mantissa, exponent] = x.toExponential(digits - 1).split("e"), p = Number(exponent);
    const short = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
    if (p >= -4 && p < digits) return short(x.toFixed(digits - 1 - p));
    return `${short(mantissa)}e${p < 0 ? "-" : "+"}${String(Math.abs(p)).padStart(2, "0")}`;
  };

  return { evaluator, verdictOf, sample, g, table, OPERATIONS: [...Object.keys(EACH), ...Object.keys(WHOLE), ...Object.keys(WINDOWED), "empty", "look up"] };
})();
if (typeof require === "function") module.exports = Program;
