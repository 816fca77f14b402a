// Runs the Khronos glTF validator (npm package gltf-validator) on files and prints its reports as JSON.
//   node validate_gltf.mjs NODE_MODULES FILE…
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";

const [modules, ...files] = process.argv.slice(2);
const validator = createRequire(resolve(modules, "gltf-validator", "package.json"))("gltf-validator");
const reports = await Promise.all(
  files.map((file) => validator.validateBytes(new Uint8Array(readFileSync(file)), { uri: file, maxIssues: 50 })),
);
console.log(JSON.stringify(reports));
