/* node course.js SCENE.json: the events that page/course.js reports for a scene with its arrays. */
"use strict";
const fs = require("fs"), path = require("path");
const Course = require(path.join(__dirname, "../../harness/report/page/course.js"));

const data = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const array = (name) => Float32Array.from(data.arrays[name], (x) => (x === null ? NaN : x));
console.log(JSON.stringify(Course.ofRun(data.scene, array, data.end, data.verdicts)));
