// Makes ../three.bundle.js, which is committed: pages are made without npm.
//   npm install --no-package-lock && npm run build
// Versions are pinned in package.json, so the same bytes come out again.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { build } from "esbuild";

const main = createRequire(import.meta.url).resolve("three"); // .../three/build/three.cjs
const three = dirname(dirname(main));
const { version } = JSON.parse(readFileSync(join(three, "package.json"), "utf8"));
const licence = readFileSync(join(three, "LICENSE"), "utf8").trim();

await build({
  entryPoints: [join(import.meta.dirname, "entry.js")],
  outfile: join(import.meta.dirname, "..", "three.bundle.js"),
  bundle: true,
  minify: true,
  charset: "utf8",
  format: "iife",
  globalName: "THREE",
  target: "es2022",
  legalComments: "none", // one notice for all of it, in full, instead of one a module
  banner: { js: `/*! three.js ${version}, https://threejs.org\n\n${licence}\n*/` },
});
