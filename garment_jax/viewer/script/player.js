// Which frame is shown: real time at the clip's rate and the chosen speed, or steps by hand.

class Player {
  constructor(fps) {
    this.fps = fps;
    this.ready = 0; // frames that are unpacked
    this.time = 0; // frames, not whole while playing
    this.speed = 1;
    this.playing = false;
  }

  get frame() {
    return Math.min(Math.floor(this.time + 1e-6), Math.max(this.ready - 1, 0));
  }

  goTo(frame) {
    this.time = Math.min(Math.max(frame, 0), Math.max(this.ready - 1, 0));
  }

  step(frames) {
    this.playing = false;
    this.goTo(this.frame + frames);
  }

  // Returns whether another frame is to be shown after `seconds` more; at the end it starts again.
  advance(seconds) {
    if (!this.playing || !this.ready) return false;
    const before = this.frame;
    this.time += seconds * this.fps * this.speed;
    if (this.time >= this.ready) this.time %= this.ready;
    return this.frame !== before;
  }
}
