/* node simulation.js RUN.json MODULE.wasm ROWS: simulates as a page does, writes the rows, prints
 * the outcome. */
"use strict";
const fs = require("fs"), path = require("path");
const page = path.join(__dirname, "../../harness/report/page");
const Simulation = require(path.join(page, "simulation.js"));

(async () => {
  const [about, code, rows] = process.argv.slice(2), data = JSON.parse(fs.readFileSync(about, "utf8"));
  const system = await Simulation.open(fs.readFileSync(code), data);
  const began = performance.now();
  let chunks = 0;
  const run = await system.run(data.values, async () => { chunks++; return false; });
  const seconds = (performance.now() - began) / 1000;
  fs.writeFileSync(rows, Buffer.from(run.values.buffer, run.values.byteOffset, run.values.byteLength));
  const sha256 = await Simulation.sha256(run.values);
  console.log(JSON.stringify({ rows: run.rows, complete: run.complete, message: run.message, seconds, chunks, sha256 }));
})();
