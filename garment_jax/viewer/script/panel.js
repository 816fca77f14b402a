// Buttons, keys, labels and the sentences about the page.

const KEYS = { o: "overlay", e: "error", b: "body", w: "wire", p: "inside", f: "follow" };

function wireChoices(see, allowed, changed) {
  const update = () => {
    for (const button of document.querySelectorAll("[data-choice]")) {
      button.hidden = !allowed[button.dataset.choice];
      button.setAttribute("aria-pressed", String(Boolean(see[button.dataset.choice])));
    }
  };
  const flip = (name) => {
    if (!allowed[name]) return;
    see[name] = !see[name];
    update();
    changed(name);
  };
  for (const button of document.querySelectorAll("[data-choice]")) {
    button.addEventListener("click", () => flip(button.dataset.choice));
  }
  update();
  return flip;
}

function wireKeys(flip, actions) {
  document.addEventListener("keydown", (event) => {
    const typing = event.target.matches("select, input[type=number]");
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const moves = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -10, ArrowUp: 10, Home: -Infinity, End: Infinity };
    if (KEYS[key]) flip(KEYS[key]);
    else if (key === " ") actions.play();
    else if (key === "r") actions.reset();
    else if (key === "t") actions.theme();
    else if (key in moves) actions.step(event.shiftKey ? 10 * moves[key] : moves[key]);
    else return;
    event.preventDefault(); // a focused button or slider must not answer, too
  });
}

function makeLabels(holder, clips) {
  return clips.map((clip) => {
    const label = document.createElement("div");
    label.className = "label";
    label.style.setProperty("--own", cssColour(clip.colour));
    const parts = ["strong", "span", "span"].map((tag) => label.appendChild(document.createElement(tag)));
    parts[0].textContent = clip.title;
    parts[2].className = "inside";
    holder.append(label);
    return { label, error: parts[1], inside: parts[2] };
  });
}

function placeLabels(labels, panels, over) {
  labels.forEach(({ label }, i) => {
    const panel = over ? panels[0] : panels[i];
    if (!panel) return;
    label.style.left = `${panel.x}px`;
    label.style.maxWidth = `${panel.width}px`;
    label.style.top = `${panel.y + (over ? 68 * i : 0)}px`;
  });
}

function fillLabel({ error, inside }, figures, see, n) {
  error.textContent =
    figures.rmse === undefined ? "" : `RMSE ${figures.rmse.toFixed(2)} cm, largest ${figures.largest.toFixed(2)} cm`;
  const count = (many, what) => `${many} ${many === 1 ? "vertex" : "vertices"} ${what} (${((100 * many) / n).toFixed(2)} %)`;
  const said = [["inside", "inside"], ["crossing", "through itself"]]
    .filter(([name]) => figures[name] !== undefined)
    .map(([name, what]) => count(figures[name], what));
  inside.classList.toggle("some", figures.inside > 0 || figures.crossing > 0);
  inside.textContent = see.inside ? said.join(", ") : "";
}

function describePage(holder, facts) {
  const number = (x) => x.toLocaleString("en");
  const lines = [
    `${number(facts.vertices)} vertices, ${number(facts.frames)} frames at ${Number(facts.fps.toFixed(3))} per second.`,
    `Positions are whole steps of ${Number((1000 * facts.step).toPrecision(3))} mm from the root, errors are ` +
      "measured on them.",
    ...facts.notes,
    "Drag to turn, right-drag or two fingers to move, wheel or pinch to zoom. Space plays, left and right " +
      "go a frame, with shift or up and down ten, Home and End to the ends. O E B W P F switch what is " +
      "shown, R resets the view, T changes light and dark.",
    "Everything is in this file; nothing is fetched. Drawn with three.js (MIT licence, in the source).",
  ];
  for (const line of lines) holder.appendChild(document.createElement("p")).textContent = line;
}
