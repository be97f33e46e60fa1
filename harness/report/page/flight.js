/* A system that flies in the page: its module, the rows of a flight, and what is computed from them.
 * It touches no document, so that node runs the same file. */
"use strict";
const Flight = (() => {
  /* ---- the module ---- */
  const CHUNK = 1000;
  const unpacked = async (packed) =>
    new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();

  /* a module and what it is told: start, step, steps, every; references of columns and of settings */
  class System {
    constructor(exports, about) {
      this.c = exports;
      this.about = about;
      this.rows = Math.ceil(about.steps / about.every) + 1;
      this.width = about.columns.length;
      exports._initialize();
      this.columns = this.words(about.columns);
      this.settings = this.words(about.settings);
      this.numbers = exports.room(8 * Math.max(1, about.settings.length));
      this.buffer = exports.room(8 * this.width * (Math.floor(CHUNK / about.every) + 2));
    }

    words(values) {
      const at = this.c.room(4 * Math.max(1, values.length));
      new Uint32Array(this.c.memory.buffer, at, values.length).set(values);
      return at;
    }

    said() {
      const bytes = new Uint8Array(this.c.memory.buffer, this.c.said());
      return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
    }

    /* macro steps before a row */
    stepsOf(row) { return Math.min(row * this.about.every, this.about.steps); }
    timeOf(row) { return this.about.start + this.stepsOf(row) * this.about.step; }

    /* one flight with these settings; pause(done): between chunks, true ends the flight.
     * values: rows as far as it came; message: why it ended, "" at its end */
    async fly(values, pause = async () => false) {
      const { start, step, steps, every } = this.about, { c, width } = this;
      const flight = { values: new Float64Array(this.rows * width), rows: 0, message: "", cancelled: false };
      const take = (count) => {
        const all = new Float64Array(c.memory.buffer, this.buffer, count * width);
        flight.values.set(all, flight.rows * width);
        flight.rows += count;
      };
      new Float64Array(c.memory.buffer, this.numbers, values.length).set(values);
      const ready = c.renew() && c.set(this.settings, this.numbers, values.length)
        && c.begin(start, step, steps, every, this.columns, width, this.buffer);
      if (!ready) return this.ended(flight, 0);
      take(1);
      let done = 0;
      while (done < steps) {
        const last = Math.min(done + CHUNK, steps);
        const reached = c.fly(done, last, this.columns, width, this.buffer);
        take(this.rowsUpTo(reached) - flight.rows);
        if (reached < last) return this.ended(flight, reached);
        done = last;
        if (done < steps && await pause(done)) return { ...this.ended(flight, done), message: "cancelled", cancelled: true };
      }
      return this.ended(flight, done, "");
    }

    rowsUpTo(done) {
      return done === this.about.steps ? this.rows : Math.floor(done / this.about.every) + 1;
    }

    ended(flight, done, message = this.said()) {
      const whole = flight.rows === this.rows && !message;
      const values = whole ? flight.values : flight.values.subarray(0, flight.rows * this.width);
      return { ...flight, values, done, message, complete: whole, time: Float64Array.from({ length: flight.rows }, (_, k) => this.timeOf(k)) };
    }
  }

  async function open(bytes, about) {
    const module = await WebAssembly.compile(bytes);
    const stubs = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module))
      (stubs[from] ||= {})[name] = () => 52; /* ENOSYS: nothing of it is needed */
    return new System((await WebAssembly.instantiate(module, stubs)).exports, about);
  }

  const hex = (buffer) => [...new Uint8Array(buffer)].map((b) => b.toString(16).padStart(2, "0")).join("");
  const sha256 = async (values) => hex(await crypto.subtle.digest("SHA-256", values));

  /* ---- arrays of any shape, as numpy has them ---- */
  const size = (shape) => shape.reduce((a, b) => a * b, 1);
  const make = (shape, data = new Float64Array(size(shape))) => ({ shape, data });
  const scalar = (value) => make([], Float64Array.of(value));
  const fault = (text) => { throw new Error(text); };

  const strides = (shape) => {
    const found = new Array(shape.length);
    for (let k = shape.length - 1, n = 1; k >= 0; n *= shape[k--]) found[k] = n;
    return found;
  };
  const together = (shapes) => {
    const axes = Math.max(0, ...shapes.map((s) => s.length));
    return Array.from({ length: axes }, (_, k) => {
      let n = 1;
      for (const s of shapes) {
        const own = s[s.length - axes + k] ?? 1;
        if (own !== 1 && n !== 1 && own !== n) fault(`shapes ${shapes.map((x) => `(${x})`).join(" ")} do not fit`);
        if (own !== 1) n = own;
      }
      return n;
    });
  };
  /* places in an array of every element of a larger shape */
  const spread = (array, shape) => {
    const n = size(shape), places = new Uint32Array(n), own = strides(array.shape), lead = shape.length - array.shape.length;
    const step = shape.map((_, k) => (k < lead || array.shape[k - lead] === 1 ? 0 : own[k - lead]));
    const at = new Array(shape.length).fill(0);
    for (let i = 0, place = 0; i < n; i++) {
      places[i] = place;
      for (let k = shape.length - 1; k >= 0; k--) {
        place += step[k];
        if (++at[k] < shape[k]) break;
        place -= step[k] * shape[k];
        at[k] = 0;
      }
    }
    return places;
  };
  const same = (a, b) => a.length === b.length && a.every((n, k) => n === b[k]);
  const broadcast = (array, shape) => {
    if (same(array.shape, shape)) return array.data;
    if (array.data.length === 1) return new Float64Array(size(shape)).fill(array.data[0]);
    return spread(array, shape).reduce((out, place, i) => { out[i] = array.data[place]; return out; }, new Float64Array(size(shape)));
  };
  const map = (f, ...arrays) => {
    const shape = together(arrays.map((a) => a.shape)), out = make(shape), { data } = out;
    const [a, b, c] = arrays.map((each) => broadcast(each, shape));
    if (arrays.length === 1) for (let i = 0; i < data.length; i++) data[i] = f(a[i]);
    else if (arrays.length === 2) for (let i = 0; i < data.length; i++) data[i] = f(a[i], b[i]);
    else for (let i = 0; i < data.length; i++) data[i] = f(a[i], b[i], c[i]);
    return out;
  };

  const axisOf = (array, axis) => (axis < 0 ? axis + array.shape.length : axis);
  /* f over the elements along an axis (null: all), from the first on */
  const reduce = (f, array, axis = null, keep = false) => {
    if (axis === null) {
      if (!array.data.length) fault("nothing to reduce");
      const shape = keep ? array.shape.map(() => 1) : [];
      return make(shape, Float64Array.of(array.data.reduce((a, b) => f(a, b))));
    }
    const k = axisOf(array, axis), n = array.shape[k], inner = size(array.shape.slice(k + 1));
    const out = make(array.shape.flatMap((m, i) => (i === k ? (keep ? [1] : []) : [m])));
    for (let i = 0; i < out.data.length; i++) {
      const first = Math.floor(i / inner) * n * inner + (i % inner);
      let value = array.data[first];
      for (let j = 1; j < n; j++) value = f(value, array.data[first + j * inner]);
      out.data[i] = value;
    }
    return out;
  };

  const RAD = Math.PI / 180;
  const least = (a, b) => (a !== a || b !== b ? NaN : a < b ? a : b);
  const most = (a, b) => (a !== a || b !== b ? NaN : a > b ? a : b);
  const fleast = (a, b) => (a !== a ? b : b !== b ? a : a < b ? a : b);
  const fmost = (a, b) => (a !== a ? b : b !== b ? a : a > b ? a : b);
  const even = (x) => { const r = Math.round(x); return Math.abs(x % 1) === 0.5 && r % 2 !== 0 ? r - 1 : r; };
  const remainder = (a, b) => { const r = a % b; return r !== 0 && (r < 0) !== (b < 0) ? r + b : r; };
  const UFUNCS = {
    add: (a, b) => a + b, subtract: (a, b) => a - b, multiply: (a, b) => a * b, divide: (a, b) => a / b,
    power: (a, b) => (a === 1 || b === 0 ? 1 : a ** b), negative: (a) => -a, positive: (a) => a, absolute: Math.abs, fabs: Math.abs,
    sqrt: Math.sqrt, square: (a) => a * a, reciprocal: (a) => 1 / a, sin: Math.sin, cos: Math.cos, tan: Math.tan,
    arcsin: Math.asin, arccos: Math.acos, arctan: Math.atan, arctan2: Math.atan2, hypot: Math.hypot,
    exp: Math.exp, log: Math.log, log10: Math.log10, degrees: (a) => a / RAD, radians: (a) => a * RAD,
    rad2deg: (a) => a / RAD, deg2rad: (a) => a * RAD, sign: Math.sign, floor: Math.floor, ceil: Math.ceil, rint: even,
    clip: (x, low, high) => least(most(x, low), high), maximum: most, minimum: least, fmax: fmost, fmin: fleast, remainder, copysign: (a, b) => (b < 0 || Object.is(b, -0) ? -Math.abs(a) : Math.abs(a)),
    greater: (a, b) => +(a > b), greater_equal: (a, b) => +(a >= b), less: (a, b) => +(a < b), less_equal: (a, b) => +(a <= b),
    equal: (a, b) => +(a === b), not_equal: (a, b) => +(a !== b), logical_and: (a, b) => +(a !== 0 && b !== 0),
    logical_or: (a, b) => +(a !== 0 || b !== 0), logical_not: (a) => +(a === 0), isfinite: (a) => +Number.isFinite(a),
    isnan: (a) => +(a !== a), isinf: (a) => +(Math.abs(a) === Infinity),
  };

  /* an index per axis: {i} a place, {s} begin, end, step (null: open), {t} places, {n} a new axis */
  const pick = (array, index, clamp = false) => {
    const axes = [], shape = [];
    let k = 0;
    for (const each of index) {
      if (each.n) { shape.push(1); continue; }
      const n = array.shape[k++];
      if (n === undefined) fault("too many indices");
      const inside = (i) => {
        const at = i < 0 ? i + n : i;
        if (clamp) return Math.min(Math.max(at, 0), n - 1);
        return at >= 0 && at < n ? at : fault(`index ${i} is out of bounds for axis ${k - 1} with size ${n}`);
      };
      if (each.i !== undefined) axes.push([inside(each.i)]);
      else if (each.t) { axes.push(each.t.map(inside)); shape.push(each.t.length); }
      else { axes.push(sliced(each.s, n)); shape.push(axes.at(-1).length); }
    }
    for (; k < array.shape.length; k++) { axes.push(sliced([null, null, null], array.shape[k])); shape.push(array.shape[k]); }
    const own = strides(array.shape), out = make(shape);
    if (!axes.length) return make(shape, array.data.slice());
    /* the places of one item of the first axis, then all items */
    let offsets = Int32Array.of(0);
    for (let j = 1; j < axes.length; j++) {
      const before = offsets, m = axes[j].length;
      offsets = new Int32Array(before.length * m);
      for (let a = 0; a < before.length; a++) for (let b = 0; b < m; b++) offsets[a * m + b] = before[a] + axes[j][b] * own[j];
    }
    const { data } = out, from = array.data, n = offsets.length;
    let at = 0;
    const items = Int32Array.from(axes[0]);
    if (array.columns && axes.length === 2 && items.length === array.shape[0]) {
      for (let k = 0; k < n; k++) {
        const column = array.columns.subarray(offsets[k] * items.length, (offsets[k] + 1) * items.length);
        for (let i = 0; i < items.length; i++) data[i * n + k] = column[items[i]];
      }
      return out;
    }
    for (let i = 0; i < items.length; i++) {
      const first = items[i] * own[0];
      for (let k = 0; k < n; k++) data[at++] = from[first + offsets[k]];
    }
    return out;
  };
  /* a table with its columns beside its rows, for picks of whole columns */
  const table = (rows, width, data) => {
    const columns = new Float64Array(data.length), BLOCK = 64;
    for (let first = 0; first < rows; first += BLOCK) {
      const last = Math.min(first + BLOCK, rows);
      for (let c = 0; c < width; c++) for (let r = first; r < last; r++) columns[c * rows + r] = data[r * width + c];
    }
    return { shape: [rows, width], data, columns };
  };
  const sliced = ([begin, end, step], n) => {
    const by = step ?? 1;
    const bound = (x, open) => (x === null || x === undefined ? open : x < 0 ? Math.max(x + n, by < 0 ? -1 : 0) : Math.min(x, by < 0 ? n - 1 : n));
    if (by === 0) fault("slice step cannot be zero");
    const from = bound(begin, by > 0 ? 0 : n - 1), to = bound(end, by > 0 ? n : -1);
    const found = new Int32Array(Math.max(0, Math.ceil((to - from) / by)));
    for (let k = 0; k < found.length; k++) found[k] = from + k * by;
    return found;
  };
  const transposed = (array, axes) => {
    const own = strides(array.shape), shape = axes.map((k) => array.shape[k]), step = axes.map((k) => own[k]);
    const out = make(shape), at = new Array(shape.length).fill(0);
    for (let i = 0, place = 0; i < out.data.length; i++) {
      out.data[i] = array.data[place];
      for (let k = shape.length - 1; k >= 0; k--) {
        place += step[k];
        if (++at[k] < shape[k]) break;
        place -= step[k] * shape[k];
        at[k] = 0;
      }
    }
    return out;
  };
  const joined = (arrays, axis) => {
    const k = axisOf(arrays[0], axis), outer = size(arrays[0].shape.slice(0, k));
    const shape = arrays[0].shape.slice();
    shape[k] = arrays.reduce((sum, a) => sum + a.shape[k], 0);
    const out = make(shape), parts = arrays.map((a) => size(a.shape.slice(k)));
    for (let i = 0, at = 0; i < outer; i++)
      arrays.forEach((a, j) => { out.data.set(a.data.subarray(i * parts[j], (i + 1) * parts[j]), at); at += parts[j]; });
    return out;
  };
  const cross = (a, b) => {
    const shape = together([a.shape, b.shape]), x = broadcast(a, shape), y = broadcast(b, shape), out = make(shape), z = out.data;
    for (let i = 0; i < z.length; i += 3) {
      z[i] = x[i + 1] * y[i + 2] - x[i + 2] * y[i + 1];
      z[i + 1] = x[i + 2] * y[i] - x[i] * y[i + 2];
      z[i + 2] = x[i] * y[i + 1] - x[i + 1] * y[i];
    }
    return out;
  };
  /* sums of products over the letters that the result does not have */
  const einsum = (letters, a, b) => {
    const [inputs, output] = letters.split("->"), [left, right] = inputs.split(",");
    const length = {};
    [[left, a], [right, b]].forEach(([names, array]) => [...names].forEach((name, k) => { length[name] = array.shape[k]; }));
    const inner = Object.keys(length).filter((name) => !output.includes(name)), names = [...output, ...inner];
    const shape = [...output].map((name) => length[name]), full = names.map((name) => length[name]), out = make(shape);
    const steps = [[left, a], [right, b]].map(([own, array]) => {
      const s = strides(array.shape);
      return names.map((name) => (own.includes(name) ? s[own.indexOf(name)] : 0));
    });
    const at = new Array(names.length).fill(0), place = [0, 0], n = size(full), sum = size(inner.map((name) => length[name]));
    for (let i = 0; i < n; i++) {
      out.data[Math.floor(i / sum)] += a.data[place[0]] * b.data[place[1]];
      for (let k = names.length - 1; k >= 0; k--) {
        steps.forEach((step, j) => { place[j] += step[k]; });
        if (++at[k] < full[k]) break;
        steps.forEach((step, j) => { place[j] -= step[k] * full[k]; });
        at[k] = 0;
      }
    }
    return out;
  };
  const reduceat = (f, array, places) => {
    const inner = size(array.shape.slice(1)), rows = array.shape[0], out = make([places.length, ...array.shape.slice(1)]);
    places.forEach((first, i) => {
      const next = i + 1 < places.length ? places[i + 1] : rows, last = next > first ? next : first + 1;
      for (let k = 0; k < inner; k++) {
        let value = array.data[first * inner + k];
        for (let row = first + 1; row < last; row++) value = f(value, array.data[row * inner + k]);
        out.data[i * inner + k] = value;
      }
    });
    return out;
  };

  /* ---- a list of operations on the rows of a flight, written when the page was made ---- */
  const OPERATIONS = {
    pick: (p, a) => pick(a, p.index, true),
    reduce: (p, a) => reduce(UFUNCS[p.by], a, p.axis ?? null, !!p.keep),
    reduceat: (p, a) => reduceat(UFUNCS[p.by], a, p.places),
    accumulate: (p, a) => accumulate(UFUNCS[p.by], a),
    reshape: (p, a) => make(p.shape, a.data),
    transpose: (p, a) => transposed(a, p.axes),
    stack: (p, ...all) => {
      const k = p.axis < 0 ? p.axis + all[0].shape.length + 1 : p.axis;
      return joined(all.map((a) => make([...a.shape.slice(0, k), 1, ...a.shape.slice(k)], a.data)), k);
    },
    concatenate: (p, ...all) => joined(all, p.axis),
    where: (_, a, b, c) => map((x, y, z) => (x !== 0 ? y : z), a, b, c),
    cross: (_, a, b) => cross(a, b),
    einsum: (p, a, b) => einsum(p.letters, a, b),
    full: (p) => make(p.shape, new Float64Array(size(p.shape)).fill(p.value)),
  };
  const accumulate = (f, a) => {
    const out = make(a.shape, a.data.slice()), inner = size(a.shape.slice(1));
    for (let i = inner; i < out.data.length; i++) out.data[i] = f(out.data[i - inner], out.data[i]);
    return out;
  };
  const number = (x) => (typeof x === "string" ? Number(x.replace("nan", "NaN").replace("inf", "Infinity")) : x);

  /* value(k): of operation k; roots: arrays by name */
  const evaluator = (operations, roots) => {
    const known = new Map();
    const value = (k) => {
      if (known.has(k)) return known.get(k);
      const [name, parts, p] = operations[k];
      let found;
      if (name === "root") found = roots[p.name] || fault(`there is no ${p.name}`);
      else if (name === "constant") found = make(p.shape, Float64Array.from(p.values, number));
      else {
        const arrays = parts.map(value);
        found = OPERATIONS[name] ? OPERATIONS[name](p, ...arrays) : map(UFUNCS[name] || fault(`unknown ${name}`), ...arrays);
      }
      known.set(k, found);
      return found;
    };
    return value;
  };

  /* the rows of a curve that are drawn: of every group the least, the largest, the first that is no
   * number (harness/report/arrays.py) */
  const keptRows = (values, points) => {
    const count = values.length;
    if (count <= points) return Array.from({ length: count }, (_, k) => k);
    const length = Math.ceil((2 * count) / points), kept = new Set([0, count - 1]);
    for (let start = 0; start < count; start += length) {
      let low = start, high = start, smallest = Infinity, largest = -Infinity;
      const end = Math.min(start + length, count);
      for (let k = start; k < end; k++) {
        if (!Number.isFinite(values[k])) { kept.add(k); break; }
      }
      for (let k = start; k < end; k++) {
        const v = values[k];
        if (!Number.isFinite(v)) continue;
        if (v < smallest) { smallest = v; low = k; }
        if (v > largest) { largest = v; high = k; }
      }
      kept.add(low).add(high);
    }
    return [...kept].sort((a, b) => a - b);
  };

  return { open, unpacked, sha256, evaluator, keptRows, make, table, scalar, map, reduce, pick, UFUNCS, together, broadcast, number, least, most };
})();
if (typeof require === "function") module.exports = Flight;
