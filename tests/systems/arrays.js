/* node arrays.js PAGE.json: what page/flight.js makes of the operations of a page over given rows. */
"use strict";
const fs = require("fs"), path = require("path");
const Flight = require(path.join(__dirname, "../../harness/report/page/flight.js"));

const told = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
for (const [, , about] of told.operations)
  for (const each of about.index || []) if (typeof each.t === "number") each.t = told.lists[each.t];
const roots = Object.fromEntries(Object.entries(told.roots).map(([name, [shape, values]]) => [name, Flight.make(shape, Float64Array.from(values))]));
roots.values = Flight.table(...roots.values.shape, roots.values.data);
const began = performance.now(), value = Flight.evaluator(told.operations, roots);
const found = told.places.map((place) => value(place)).map(({ shape, data }) => ({ shape, data: Array.from(data, String) }));
console.log(JSON.stringify({ found, seconds: (performance.now() - began) / 1000 }));
