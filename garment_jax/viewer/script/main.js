// The page as a whole: unpack, lay out, play.

const facts = JSON.parse(document.getElementById("facts").textContent);
const find = (id) => document.getElementById(id);
const see = { overlay: false, error: false, body: true, wire: false, inside: true, follow: true };
const player = new Player(facts.fps);
const clock = { draws: 0, script: 0, begin: performance.now() }; // how long our own work takes a frame

const clips = facts.sequences.map((sequence, i) => ({
  ...sequence,
  vertices: facts.vertices,
  isTruth: i === facts.truth,
  measured: facts.truth !== null && i !== facts.truth,
  steps: new Int16Array(3 * facts.vertices * facts.frames),
  values: new Float64Array(facts.frames),
  ready: 0,
  top: 0,
  bits: null,
}));
for (const clip of clips) {
  const same = clips.some((other) => other !== clip && other.name === clip.name && other.kind === clip.kind);
  clip.title = [same ? clip.file : clip.name, clip.kind].filter(Boolean).join(", ");
}
const truth = facts.truth === null ? null : clips[facts.truth];
const measured = clips.filter((clip) => clip.measured);
const histogram = new Histogram();
const labels = makeLabels(find("labels"), clips);
let stage, curve, root, latest;

function rootAt(frame) {
  return [root[3 * frame], root[3 * frame + 1], root[3 * frame + 2]];
}

async function build() {
  const [faces, order, parent, path] = await Promise.all(
    [facts.faces, facts.order, facts.parent, facts.root].map(readBlock),
  );
  root = new Float32Array(path);
  const index = new Uint32Array(faces);
  stage = new Stage(find("stage"), facts, facts.floor);
  if (facts.body) {
    const names = ["vertices", "faces", "colours", "skin_joints", "skin_weights", "matrices"];
    const [v, f, c, j, w, m] = await Promise.all(names.map((name) => readBlock(facts.body[name])));
    stage.body = new BodyFigure(
      {
        vertices: new Float32Array(v), faces: new Uint32Array(f), colours: new Uint8Array(c),
        skinJoints: new Uint16Array(j), skinWeights: new Float32Array(w), matrices: new Float32Array(m),
        joints: facts.body.joints,
      },
      stage.shared,
    );
    stage.scene.add(stage.body.group);
  }
  const edges = uniqueEdges(index, facts.vertices);
  stage.garments = clips.map((clip) => new GarmentFigure(clip, index, edges, stage.shared));
  stage.scene.add(...stage.garments.map((garment) => garment.group));
  return { order: new Int32Array(order), parent: new Int32Array(parent) };
}

// Unpacks chunk after chunk; what is there can be played at once.
async function unpack(walk) {
  for (const clip of clips) {
    for (const name of ["inside", "crossing"]) {
      if (clip[name]) clip.marks = { ...clip.marks, [name]: new Uint8Array(await readBlock(clip[name])) };
    }
  }
  const size = 3 * facts.vertices;
  const errors = new Float32Array(facts.vertices);
  for (let c = 0, start = 0; start < facts.frames; c++) {
    let count = 0;
    for (const clip of clips) {
      const bytes = new Uint8Array(await readBlock(clip.chunks[c]));
      count = unpackChunk(bytes, walk, clip.steps.subarray(start * size));
    }
    for (const clip of measured) {
      for (let f = start; f < start + count; f++) {
        const { rmse } = measureFrame(clip.steps, truth.steps, f, facts.vertices, 100 * facts.step, errors);
        clip.values[f] = rmse;
        clip.top = Math.max(clip.top, rmse);
        histogram.add(errors);
      }
      clip.ready = start + count;
    }
    if (start === 0) firstView();
    start += count;
    player.ready = start;
    find("scrub").max = start - 1;
    find("loading").querySelector("progress").value = start / facts.frames;
    curve?.draw(player.frame);
  }
}

function firstView() {
  player.ready = 1;
  layOut();
  showFrame();
  const garments = stage.garments.map(({ position }) => position.array);
  let top = -Infinity;
  for (const positions of garments) for (let i = 1; i < positions.length; i += 3) top = Math.max(top, positions[i]);
  const body = facts.body ? facts.body.height : 0;
  const height = Math.max(top + root[1] - facts.floor, body);
  stage.frameFigure(rootAt(0), height, facts.forward);
}

function showFrame() {
  const began = performance.now();
  const frame = player.frame;
  latest = stage.garments.map((garment) => garment.show(frame, truth, facts.step));
  if (stage.body) stage.body.show(frame);
  stage.place(rootAt(frame), see.follow);
  labels.forEach((label, i) => fillLabel(label, latest[i], see, facts.vertices));
  const number = String(facts.start + frame * facts.every);
  const [b, rest] = [document.createElement("b"), ` of ${facts.start + (facts.frames - 1) * facts.every}`];
  b.textContent = `frame ${number}`;
  find("clock").replaceChildren(b, `${rest}, ${(frame / facts.fps).toFixed(2)} s`);
  find("scrub").value = frame;
  curve?.draw(frame);
  clock.draws++;
  clock.script += performance.now() - began;
}

function layOut() {
  const over = see.overlay && clips.length > 1;
  stage.layOut(over ? 1 : clips.length);
  placeLabels(labels, stage.panels, over);
  curve?.draw(player.frame);
}

function goTo(frame) {
  player.goTo(frame);
  showFrame();
}

const actions = {
  play() {
    player.playing = !player.playing;
    document.querySelector("[data-action=play]").textContent = player.playing ? "❚❚" : "▶";
  },
  step(frames) {
    if (player.playing) actions.play();
    player.step(frames);
    showFrame();
  },
  reset() {
    stage.frameFigure(rootAt(player.frame), stage.figure.height, facts.forward);
  },
  theme() {
    const dark = document.documentElement.dataset.theme !== "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    stage.colour(styleOf("--sky"), styleOf("--grid"));
    curve?.draw(player.frame);
  },
};

function setScale(cm) {
  if (!(cm > 0)) return;
  stage.shared.heatTop.value = cm;
  find("scale-top").value = Number(cm.toPrecision(3));
  stage.stale = true;
}

function wire() {
  const allowed = {
    overlay: clips.length > 1, error: Boolean(measured.length), body: Boolean(facts.body), wire: true,
    inside: clips.some((clip) => clip.crossing), follow: true,
  };
  const flip = wireChoices(see, allowed, (name) => {
    if (name === "overlay") layOut();
    find("scale").hidden = !see.error;
    labels.forEach((label, i) => latest && fillLabel(label, latest[i], see, facts.vertices));
    stage.stale = true;
  });
  wireKeys(flip, actions);
  for (const button of document.querySelectorAll("[data-action]")) {
    button.addEventListener("click", () => actions[button.dataset.action]());
  }
  find("scrub").addEventListener("input", (event) => goTo(Number(event.target.value)));
  find("speed").addEventListener("change", (event) => (player.speed = Number(event.target.value)));
  find("scale-top").addEventListener("input", (event) => {
    const cm = Number(event.target.value);
    if (cm > 0) stage.shared.heatTop.value = cm;
    stage.stale = true;
  });
  const colours = facts.heat.map(cssColour).join(", ");
  find("scale").querySelector("i").style.background = `linear-gradient(to right, ${colours})`;
  new ResizeObserver(layOut).observe(find("stage"));
}

function wireCurve() {
  if (!measured.length) return;
  find("errors").hidden = false;
  curve = new ErrorCurve(find("curve"), facts, measured, goTo);
}

function summarise() {
  const legend = document.querySelector(".legend");
  for (const clip of measured) {
    const name = document.createElement("b");
    name.textContent = clip.title;
    name.style.setProperty("--own", cssColour(clip.colour));
    const line = document.createElement("span");
    const total = rootMeanSquare(clip.values, facts.frames);
    line.append(name, ` RMSE ${total.toFixed(2)} cm over all frames, against ${truth.title}`);
    legend.append(line);
  }
  setScale(facts.scale_cm ?? roundUp(histogram.quantile(0.99)));
}

let before = 0;
function tick(now) {
  const seconds = Math.min((now - before) / 1000, 0.25); // a hidden page must not jump ahead
  before = now;
  if (player.advance(seconds)) showFrame();
  if (stage.stale && stage.panels.length) stage.draw(see);
  requestAnimationFrame(tick);
}

async function start() {
  document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  document.querySelector("[data-action=play]").textContent = "▶";
  describePage(find("about"), facts);
  const walk = await build();
  stage.colour(styleOf("--sky"), styleOf("--grid"));
  wire();
  wireCurve();
  requestAnimationFrame(tick);
  await unpack(walk);
  summarise();
  find("loading").hidden = true;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (clips.length === 1 && facts.frames > 1 && !still && player.time === 0 && !player.playing) actions.play();
}

// For scripts and the console: what is shown and what was measured.
globalThis.garmentViewer = { facts, clips, player, see, clock, goTo, actions, ready: start() };
globalThis.garmentViewer.ready.catch((error) => {
  find("loading").hidden = true;
  find("failure").hidden = false;
  find("failure").textContent = `The page could not be shown: ${error.message}`;
  throw error;
});
