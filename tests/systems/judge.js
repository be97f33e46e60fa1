/* node judge.js RUN.json: the verdicts of page/judge.js over given rows. */
"use strict";
const fs = require("fs"), path = require("path");
const page = path.join(__dirname, "../../harness/report/page");
const Flight = require(path.join(page, "flight.js")), Judge = require(path.join(page, "judge.js"));

const told = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const number = (x) => (x === null ? NaN : x);
const flight = {
  time: Float64Array.from(told.time), complete: told.complete,
  column: (name) => Flight.make(told.columns[name][0], Float64Array.from(told.columns[name][1], number)),
  parameter: (name) => Flight.make(told.parameters[name][0], Float64Array.from(told.parameters[name][1], number)),
};
console.log(JSON.stringify(told.requirements.map((each) => Judge.judged(flight, each))));
