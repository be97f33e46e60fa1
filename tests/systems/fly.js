/* node fly.js FLIGHT.json MODULE.wasm ROWS: flies as a page does, writes the rows, prints what became
 * of it. */
"use strict";
const fs = require("fs"), path = require("path");
const page = path.join(__dirname, "../../harness/report/page");
const Flight = require(path.join(page, "flight.js")), Judge = require(path.join(page, "judge.js"));

(async () => {
  const [about, code, rows] = process.argv.slice(2), told = JSON.parse(fs.readFileSync(about, "utf8"));
  const system = await Flight.open(fs.readFileSync(code), told);
  const began = performance.now();
  let chunks = 0;
  const flight = await system.fly(told.values, async () => { chunks++; return false; });
  const seconds = (performance.now() - began) / 1000;
  fs.writeFileSync(rows, Buffer.from(flight.values.buffer, flight.values.byteOffset, flight.values.byteLength));
  const sha256 = await Flight.sha256(flight.values);
  console.log(JSON.stringify({ rows: flight.rows, complete: flight.complete, message: flight.message, seconds, chunks, sha256 }));
})();
