/* node program.js RUN.json: values, samples and verdicts that page/program.js computes over given rows. */
"use strict";
const fs = require("fs"), path = require("path");
const Program = require(path.join(__dirname, "../../harness/report/page/program.js"));

const given = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const number = (x) => (x === null ? NaN : Number(x));
const run = {
  time: Float64Array.from(given.time), complete: given.complete,
  lookUp: (name) => { const [n, m, data] = given.tables[name]; return Program.table(n, m, Float64Array.from(data, number)); },
};
const value = Program.evaluator(given.program, run);
const plain = ({ n, m, data }) => [n, m, Array.from(data, String)];
const attempt = (k) => { try { return plain(value(k)); } catch (error) { return error.message; } };
console.log(JSON.stringify({
  values: (given.wanted || []).map(attempt),
  samples: (given.samples || []).map(([history, over, rows]) => plain(Program.sample(value(history), over, given.rows[rows]))),
  verdicts: (given.requirements || []).map((each) => Program.verdictOf(run, value, each)),
  operations: Program.OPERATIONS,
}));
