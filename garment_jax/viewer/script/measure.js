// Errors in centimetres, from positions in steps relative to the same root.

// Writes each vertex's distance to `out` and returns the frame's { rmse, largest }.
function measureFrame(steps, truth, frame, n, stepCm, out) {
  let squares = 0;
  let largest = 0;
  for (let i = 0, at = 3 * n * frame; i < n; i++, at += 3) {
    const x = steps[at] - truth[at];
    const y = steps[at + 1] - truth[at + 1];
    const z = steps[at + 2] - truth[at + 2];
    const square = x * x + y * y + z * z;
    squares += square;
    if (square > largest) largest = square;
    out[i] = stepCm * Math.sqrt(square);
  }
  return { rmse: stepCm * Math.sqrt(squares / n), largest: stepCm * Math.sqrt(largest) };
}

// The clip's RMSE is the root of the mean of the squares, not the mean of the frames' values.
function rootMeanSquare(values, count) {
  let squares = 0;
  for (let i = 0; i < count; i++) squares += values[i] * values[i];
  return Math.sqrt(squares / Math.max(count, 1));
}

// Counts errors in classes 2 % wide, from a micrometre up: enough to choose the colours' end.
class Histogram {
  constructor() {
    this.counts = new Float64Array(1024);
    this.total = 0;
  }

  add(errors) {
    for (const error of errors) {
      const place = error > 1e-4 ? Math.min(1023, 1 + Math.floor(Math.log(error / 1e-4) / Math.log(1.02))) : 0;
      this.counts[place]++;
    }
    this.total += errors.length;
  }

  // The error in cm that `part` of the values do not exceed, up to 2 %.
  quantile(part) {
    let seen = 0;
    for (let place = 0; place < 1024; place++) {
      seen += this.counts[place];
      if (seen >= part * this.total) return place ? 1e-4 * 1.02 ** place : 0;
    }
    return 0;
  }
}

// A round number of cm at or above `top`: 1, 2, 3, 4, 5, 6, 8 or 10 times a power of ten.
function roundUp(top) {
  if (!(top > 1e-6)) return 1;
  const power = 10 ** Math.floor(Math.log10(top));
  return Number(([1, 2, 3, 4, 5, 6, 8, 10].find((s) => s * power >= top * 0.98) * power).toPrecision(3));
}

function countBits(bits, start, stop) {
  let count = 0;
  for (let i = start; i < stop; i++) for (let b = bits[i]; b; b &= b - 1) count++;
  return count;
}
