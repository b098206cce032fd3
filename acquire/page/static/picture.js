// The camera's picture on a canvas: fitted or pixel for pixel, with what is clipped or unlit.

const CLIPPED = 1, UNLIT = 2;
const COLOURS = { [CLIPPED]: [213, 94, 0, 255], [UNLIT]: [47, 111, 159, 150] };
const MAX_SCALE = 32;

export class PictureView {
  constructor(canvas, wantRegion) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.wantRegion = wantRegion;
    this.marked = { [CLIPPED]: true, [UNLIT]: false };
    this.print = null;
    this.scale = null; // screen pixels for a pixel of the picture; null: fitted
    this.centre = [0, 0];
    this.pointer = null;
    this.region_wanted = "null";
    this.drawn = () => {};
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerleave", () => { this.pointer = null; });
  }

  async show(head) {
    const [image, marks] = await Promise.all([
      createImageBitmap(new Blob([head.files[0]], { type: head.media_type })),
      createImageBitmap(new Blob([head.files[1]], { type: "image/png" })),
    ]);
    const fresh = !this.print || this.print.head.size.join() !== head.size.join();
    this.print = { head, image, marks, overlay: null };
    if (fresh) this.centre = [head.size[0] / 2, head.size[1] / 2];
    this.draw();
  }

  mark(kind, on) {
    this.marked[kind] = on;
    if (this.print) this.print.overlay = null;
    this.draw();
  }

  fit() {
    this.scale = null;
    this.changed();
  }

  toggle() {
    if (this.scale !== null) return this.fit();
    this.zoom(1, this.pointer);
  }

  zoom(scale, at) {
    if (!this.print) return;
    const place = this.place();
    const [x, y] = at ?? [this.canvas.width / 2, this.canvas.height / 2];
    const under = [(x - place.left) / place.scale, (y - place.top) / place.scale];
    const least = this.fitted();
    if (scale <= least && scale < 1) return this.fit();
    this.scale = Math.min(Math.max(scale, Math.min(least, 1)), MAX_SCALE);
    this.centre = [
      under[0] - (x - this.canvas.width / 2) / this.scale,
      under[1] - (y - this.canvas.height / 2) / this.scale,
    ];
    this.changed();
  }

  fitted() {
    const [width, height] = this.print.head.size;
    return Math.min(this.canvas.width / width, this.canvas.height / height);
  }

  place() {
    const [width, height] = this.print.head.size;
    const scale = this.scale ?? this.fitted();
    const centre = this.scale === null ? [width / 2, height / 2] : this.centre;
    return {
      scale,
      left: Math.round(this.canvas.width / 2 - centre[0] * scale),
      top: Math.round(this.canvas.height / 2 - centre[1] * scale),
    };
  }

  draw() {
    const { canvas, context } = this;
    context.fillStyle = "#000";
    context.fillRect(0, 0, canvas.width, canvas.height);
    if (!this.print) return;
    const { head, image } = this.print;
    const { scale, left, top } = this.place();
    const [x, y, width, height] = head.box;
    const target = [left + x * scale, top + y * scale, width * scale, height * scale];
    context.imageSmoothingEnabled = scale * head.reduced < 1;
    context.drawImage(image, ...target);
    if (this.marked[CLIPPED] || this.marked[UNLIT]) {
      this.print.overlay ??= coloured(this.print.marks, this.marked);
      context.drawImage(this.print.overlay, ...target);
    }
    const whole = head.focus_box[2] === width && head.focus_box[3] === height;
    if (!whole) {
      context.strokeStyle = "#555";
      const [a, b, c, d] = head.focus_box;
      context.strokeRect(left + a * scale, top + b * scale, c * scale, d * scale);
    }
    Object.assign(canvas.dataset, { left, top, scale, number: head.number, step: head.frame?.step ?? "" });
    this.drawn();
  }

  // A new line knows nothing of what this viewer looks at.
  askAgain() {
    this.region_wanted = "null";
    this.changed();
  }

  changed() {
    this.draw();
    const region = this.region();
    const text = JSON.stringify(region);
    if (text === this.region_wanted) return;
    this.region_wanted = text;
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.wantRegion(region), 80);
  }

  region() {
    if (this.scale === null || !this.print) return null;
    const { scale, left, top } = this.place();
    const [width, height] = this.print.head.size;
    const x = Math.max(Math.floor(-left / scale), 0), y = Math.max(Math.floor(-top / scale), 0);
    const right = Math.min(Math.ceil((this.canvas.width - left) / scale), width);
    const bottom = Math.min(Math.ceil((this.canvas.height - top) / scale), height);
    return right > x && bottom > y ? [x, y, right - x, bottom - y] : null;
  }

  resize() {
    const { canvas } = this;
    const width = Math.round(canvas.clientWidth * devicePixelRatio);
    const height = Math.round(canvas.clientHeight * devicePixelRatio);
    if (canvas.width === width && canvas.height === height) return;
    [canvas.width, canvas.height] = [width, height];
    this.changed();
  }

  wheel(event) {
    event.preventDefault();
    if (!this.print) return;
    this.step(event.deltaY < 0 ? 2 : 0.5, this.at(event));
  }

  // To the next whole power of two.
  step(factor, at) {
    if (!this.print) return;
    const now = Math.log2(this.scale ?? this.fitted());
    this.zoom(2 ** (factor > 1 ? Math.floor(now + 1) : Math.ceil(now - 1)), at);
  }

  pan(right, down) {
    if (this.scale === null || !this.print) return;
    const part = [right * this.canvas.width, down * this.canvas.height];
    this.centre = this.centre.map((centre, k) => centre + part[k] / 8 / this.scale);
    this.changed();
  }

  grab(event) {
    if (this.scale === null) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.grabbed = { from: this.at(event), centre: [...this.centre] };
    this.canvas.addEventListener("pointerup", () => { this.grabbed = null; }, { once: true });
  }

  move(event) {
    this.pointer = this.at(event);
    if (!this.grabbed) return;
    const { from, centre } = this.grabbed;
    this.centre = centre.map((c, k) => c - (this.pointer[k] - from[k]) / this.scale);
    this.changed();
  }

  at(event) {
    return [event.offsetX * devicePixelRatio, event.offsetY * devicePixelRatio];
  }
}

function coloured(marks, wanted) {
  const canvas = new OffscreenCanvas(marks.width, marks.height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(marks, 0, 0);
  const pixels = context.getImageData(0, 0, marks.width, marks.height);
  for (let at = 0; at < pixels.data.length; at += 4) {
    const mark = pixels.data[at];
    pixels.data.set(wanted[mark] ? COLOURS[mark] : [0, 0, 0, 0], at);
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}

export function drawHistogram(canvas, histogram) {
  const context = sized(canvas);
  const top = Math.log1p(Math.max(...histogram.flat()));
  context.globalCompositeOperation = "lighter";
  ["#4a1616", "#133a1b", "#14264a"].forEach((colour, channel) => {
    const counts = histogram[channel];
    const step = canvas.width / counts.length;
    context.fillStyle = colour;
    counts.forEach((count, bin) => {
      const height = (Math.log1p(count) / top) * canvas.height;
      context.fillRect(bin * step, canvas.height - height, Math.max(step - 1, 1), height);
    });
  });
  context.globalCompositeOperation = "source-over";
}

export function drawSharpness(canvas, figures, now, span) {
  const context = sized(canvas);
  const best = Math.max(...figures.map((figure) => figure.value));
  if (!(best > 0)) return;
  const x = (figure) => canvas.width * (1 - (now - figure.at) / span);
  const y = (value) => canvas.height * (1 - 0.92 * (value / best));
  context.strokeStyle = "#3c3c3c";
  context.beginPath();
  context.moveTo(0, y(best));
  context.lineTo(canvas.width, y(best));
  context.stroke();
  context.strokeStyle = "#8a8a8a";
  context.lineWidth = 1.5;
  context.beginPath();
  figures.forEach((figure) => context.lineTo(x(figure), y(figure.value)));
  context.stroke();
}

export function sized(canvas) {
  const width = Math.round(canvas.clientWidth * devicePixelRatio);
  const height = Math.round(canvas.clientHeight * devicePixelRatio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  return context;
}
