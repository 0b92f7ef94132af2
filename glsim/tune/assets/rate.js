// How many pictures a second are on the screen, and how long the denoiser takes, in a corner of the page.

// The rate counts the pictures of the last two seconds: it does not flicker, and falls to 0 in a pause.
const WINDOW_MS = 2000,
  EVERY_MS = 500;

export class Rate {
  // place: an element; frames: number of a recording's frames, null for a camera.
  constructor(place, frames) {
    this.place = place;
    this.frames = frames;
    this.times = [];
    this.head = null;
    setInterval(() => this.write(), EVERY_MS);
  }

  // A picture with this head is on the screen.
  painted(head) {
    this.times.push(performance.now());
    this.head = head;
  }

  write() {
    const since = performance.now() - WINDOW_MS;
    while (this.times.length && this.times[0] < since) this.times.shift();
    if (!this.head) return;
    const rate = (1000 * this.times.length) / WINDOW_MS;
    const frame = this.frames ? `frame ${this.head.source_frame + 1} of ${this.frames}` : `frame ${this.head.source_frame + 1}`;
    this.place.textContent = `${rate.toFixed(1)} frames/s · denoiser ${this.head.milliseconds.toFixed(0)} ms · ${frame}`;
    this.place.dataset.rate = rate;
  }
}
