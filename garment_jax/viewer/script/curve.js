// The error of every frame, RMSE in cm, with a cursor; a click or a drag goes to that frame.

class ErrorCurve {
  constructor(canvas, facts, lines, goTo) {
    Object.assign(this, { canvas, facts, lines, goTo });
    this.frame = 0;
    const seek = (event) => {
      if (event.type === "pointerdown") canvas.setPointerCapture(event.pointerId);
      if (event.buttons & 1) goTo(this.frameAt(event.offsetX));
    };
    canvas.addEventListener("pointerdown", seek);
    canvas.addEventListener("pointermove", seek);
  }

  get box() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return { left: 46, right: width - 10, top: 8, bottom: height - 19 };
  }

  frameAt(x) {
    const { left, right } = this.box;
    const part = (x - left) / Math.max(right - left, 1);
    return Math.round(Math.min(1, Math.max(0, part)) * (this.facts.frames - 1));
  }

  xOf(frame) {
    const { left, right } = this.box;
    return left + ((right - left) * frame) / Math.max(this.facts.frames - 1, 1);
  }

  draw(frame) {
    this.frame = frame;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio)) this.canvas.width = Math.round(width * ratio);
    if (this.canvas.height !== Math.round(height * ratio)) this.canvas.height = Math.round(height * ratio);
    const ink = this.canvas.getContext("2d");
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    ink.clearRect(0, 0, width, height);
    const top = roundUp(Math.max(1e-3, ...this.lines.map((line) => line.top)) * 1.02);
    this.drawAxes(ink, top);
    for (const line of this.lines) this.drawLine(ink, line, top);
    this.drawCursor(ink, top);
  }

  drawAxes(ink, top) {
    const { left, right, bottom } = this.box;
    ink.font = "11px system-ui, sans-serif";
    ink.strokeStyle = styleOf("--line");
    ink.fillStyle = styleOf("--faint");
    ink.lineWidth = 1;
    ink.textAlign = "right";
    for (const part of [0, 0.5, 1]) {
      const y = Math.round(this.yOf(part * top, top)) + 0.5;
      ink.beginPath();
      ink.moveTo(left, y);
      ink.lineTo(right, y);
      ink.stroke();
      ink.fillText(`${Number((part * top).toPrecision(3))}${part === 1 ? " cm" : ""}`, left - 5, y + 4);
    }
    ink.textAlign = "center";
    const seconds = this.facts.frames / this.facts.fps;
    const room = Math.max(2, Math.floor((right - left) / 70));
    const apart = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600].find((s) => seconds / s <= room) || 1800;
    for (let s = 0; s < seconds; s += apart) {
      ink.fillText(`${Number(s.toFixed(1))} s`, Math.min(right - 10, Math.max(left, this.xOf(s * this.facts.fps))), bottom + 15);
    }
  }

  yOf(value, top) {
    const box = this.box;
    return box.bottom - ((box.bottom - box.top) * Math.min(value, top)) / top;
  }

  drawLine(ink, line, top) {
    ink.strokeStyle = cssColour(line.colour);
    ink.lineWidth = 1.6;
    ink.lineJoin = "round";
    ink.beginPath();
    for (let f = 0; f < line.ready; f++) ink.lineTo(this.xOf(f), this.yOf(line.values[f], top));
    ink.stroke();
  }

  drawCursor(ink, top) {
    const { top: high, bottom } = this.box;
    const x = this.xOf(this.frame);
    ink.strokeStyle = styleOf("--ink");
    ink.lineWidth = 1;
    ink.beginPath();
    ink.moveTo(x, high - 4);
    ink.lineTo(x, bottom);
    ink.stroke();
    for (const line of this.lines) {
      if (this.frame >= line.ready) continue;
      ink.fillStyle = cssColour(line.colour);
      ink.beginPath();
      ink.arc(x, this.yOf(line.values[this.frame], top), 3.5, 0, 2 * Math.PI);
      ink.fill();
    }
  }
}

function styleOf(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function cssColour(colour) {
  return `rgb(${colour.map((c) => Math.round(255 * c)).join(" ")})`;
}
