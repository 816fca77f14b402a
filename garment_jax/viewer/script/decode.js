// Blocks of the page: base64 text of a zlib stream in <script type="text/plain" id="...">.

async function readBlock(id) {
  const element = document.getElementById(id);
  const bytes = fromBase64(element.textContent);
  element.remove(); // tens of megabytes of text that nobody needs again
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

// Undoes payload.pack_chunk: [3, frames, n] second differences of differences along the walk, low bytes
// before high ones. Writes steps [frames, n, 3] to `out` (Int16Array); all sums wrap at 16 bits.
function unpackChunk(bytes, walk, out) {
  const n = walk.order.length;
  const count = bytes.length / 2;
  const frames = count / (3 * n);
  const change = [new Int16Array(n), new Int16Array(n)]; // the last frame and the one before it
  const ranked = new Int16Array(n);
  let at = 0;
  for (let axis = 0; axis < 3; axis++) {
    for (let frame = 0; frame < frames; frame++) {
      const [last, before] = change;
      for (let rank = 0; rank < n; rank++, at++) {
        const folded = bytes[at] | (bytes[count + at] << 8);
        const rest = (folded >>> 1) ^ -(folded & 1);
        const guess = frame === 0 ? 0 : frame === 1 ? last[rank] : 2 * last[rank] - before[rank];
        before[rank] = guess + rest;
        const parent = walk.parent[rank];
        ranked[rank] = before[rank] + (parent < 0 ? 0 : ranked[parent]);
        out[3 * (frame * n + walk.order[rank]) + axis] = ranked[rank];
      }
      change.reverse();
    }
  }
  return frames;
}
