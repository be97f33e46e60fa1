/* node course.js SCENE.json: what page/course.js makes of a scene with its arrays. */
"use strict";
const fs = require("fs"), path = require("path");
const Course = require(path.join(__dirname, "../../harness/report/page/course.js"));

const told = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const array = (name) => Float32Array.from(told.arrays[name], (x) => (x === null ? NaN : x));
console.log(JSON.stringify(Course.told(told.scene, array, told.end, told.verdicts)));
