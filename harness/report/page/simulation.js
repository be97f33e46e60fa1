/* Simulation in the page: runs the WebAssembly module of a system and returns the rows. This
 * file does not use the document, so that Node.js can run it. */
"use strict";
const Simulation = (() => {
  /* ---- the module ---- */
  const CHUNK = 1000;
  const unpacked = async (packed) =>
    new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();

  /* WebAssembly module of a system. about: start time and macro step (start, step) [s], number of
   * macro steps (steps), macro steps per row (every), references of columns and parameters */
  class System {
    constructor(exports, about) {
      this.c = exports;
      this.about = about;
      this.rows = Math.ceil(about.steps / about.every) + 1;
      this.width = about.columns.length;
      exports._initialize();
      this.columns = this.words(about.columns);
      this.settings = this.words(about.settings);
      this.numbers = exports.reserve(8 * Math.max(1, about.settings.length));
      this.buffer = exports.reserve(8 * this.width * (Math.floor(CHUNK / about.every) + 2));
    }

    words(values) {
      const at = this.c.reserve(4 * Math.max(1, values.length));
      new Uint32Array(this.c.memory.buffer, at, values.length).set(values);
      return at;
    }

    message() {
      const bytes = new Uint8Array(this.c.memory.buffer, this.c.message());
      return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
    }

    /* number of macro steps from the start of the run to a row */
    stepsOf(row) { return Math.min(row * this.about.every, this.about.steps); }
    timeOf(row) { return this.about.start + this.stepsOf(row) * this.about.step; }

    /* Runs the system with these values of its parameters. pause(done) is called after every CHUNK
     * macro steps with the number of completed steps; it returns true to cancel the run. Returns an
     * object with values (all rows up to the end), time [s], message (reason of an early end,
     * otherwise ""), complete and cancelled. */
    async run(values, pause = async () => false) {
      const { start, step, steps, every } = this.about, { c, width } = this;
      const result = { values: new Float64Array(this.rows * width), rows: 0, message: "", cancelled: false };
      const take = (count) => {
        const all = new Float64Array(c.memory.buffer, this.buffer, count * width);
        result.values.set(all, result.rows * width);
        result.rows += count;
      };
      new Float64Array(c.memory.buffer, this.numbers, values.length).set(values);
      const ready = c.restart() && c.set(this.settings, this.numbers, values.length)
        && c.begin(start, step, steps, every, this.columns, width, this.buffer);
      if (!ready) return this.ended(result, 0);
      take(1);
      let done = 0;
      while (done < steps) {
        const last = Math.min(done + CHUNK, steps);
        const reached = c.run(done, last, this.columns, width, this.buffer);
        take(this.rowsUpTo(reached) - result.rows);
        if (reached < last) return this.ended(result, reached);
        done = last;
        if (done < steps && await pause(done)) return { ...this.ended(result, done), message: "cancelled", cancelled: true };
      }
      return this.ended(result, done, "");
    }

    rowsUpTo(done) {
      return done === this.about.steps ? this.rows : Math.floor(done / this.about.every) + 1;
    }

    ended(result, done, message = this.message()) {
      const whole = result.rows === this.rows && !message;
      const values = whole ? result.values : result.values.subarray(0, result.rows * this.width);
      return { ...result, values, done, message, complete: whole, time: Float64Array.from({ length: result.rows }, (_, k) => this.timeOf(k)) };
    }
  }

  async function open(bytes, about) {
    const module = await WebAssembly.compile(bytes);
    const stubs = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module))
      (stubs[from] ||= {})[name] = () => 52; /* ENOSYS: no system call is needed */
    return new System((await WebAssembly.instantiate(module, stubs)).exports, about);
  }

  const hex = (buffer) => [...new Uint8Array(buffer)].map((b) => b.toString(16).padStart(2, "0")).join("");
  const sha256 = async (values) => hex(await crypto.subtle.digest("SHA-256", values));

  /* indices of the rows of a curve that are drawn: of every group of rows the smallest, the
   * largest and the first that is not finite, as thinned_rows() of harness/report/arrays.py
   * returns them */
  const thinnedRows = (values, points) => {
    const count = values.length;
    if (count <= points) return Array.from({ length: count }, (_, k) => k);
    const length = Math.ceil((2 * count) / points), chosen = new Set([0, count - 1]);
    for (let start = 0; start < count; start += length) {
      let low = start, high = start, smallest = Infinity, largest = -Infinity;
      const end = Math.min(start + length, count);
      for (let k = start; k < end; k++) {
        if (!Number.isFinite(values[k])) { chosen.add(k); break; }
      }
      for (let k = start; k < end; k++) {
        const v = values[k];
        if (!Number.isFinite(v)) continue;
        if (v < smallest) { smallest = v; low = k; }
        if (v > largest) { largest = v; high = k; }
      }
      chosen.add(low).add(high);
    }
    return [...chosen].sort((a, b) => a - b);
  };

  /* indices of the rows of a curve that are drawn. If x is time (timed), the extremes of y are
   * among them, otherwise the extremes of x and of y. */
  const drawnRows = (x, y, timed, points) => {
    if (timed || x.length <= points) return thinnedRows(y, points);
    const half = Math.floor(points / 2);
    return [...new Set([...thinnedRows(x, half), ...thinnedRows(y, half)])].sort((a, b) => a - b);
  };

  return { open, unpacked, sha256, drawnRows };
})();
if (typeof require === "function") module.exports = Simulation;
