// The last frame beside what it should show: the same part of the picture, at the same light.

import { put } from "./panels.js";

const element = (id) => document.getElementById(id);

export class Beside {
  constructor(view, place) {
    this.view = view;
    this.place = place;
    this.canvases = [element("prediction"), element("difference")];
    this.images = [null, null];
    view.drawn = () => this.draw();
    for (const canvas of this.canvases) new ResizeObserver(() => this.draw()).observe(canvas);
  }

  async show(head) {
    const files = head.files.filter((file) => file.length);
    this.images = await Promise.all(
      files.map((file) => createImageBitmap(new Blob([file], { type: "image/png" }))));
    this.place.hidden = false;
    put("how", head.how + held(head.holds));
    put("missed", missed(head));
    this.canvases[1].title = `blue: darker than it should be, red: brighter; full colour at ` +
      `${percent(head.span)} of white; grey: saturated or not known`;
    Object.assign(this.canvases[0].dataset, { number: head.number, shown: this.images.length });
    this.draw();
  }

  hide() {
    this.place.hidden = true;
  }

  // Where the middle of the large picture is, in the middle; as much of it as there fits.
  draw() {
    if (this.place.hidden || !this.view.print) return;
    const [width, height] = this.view.print.head.size;
    const { scale, left, top } = this.view.place();
    const large = this.view.canvas;
    this.canvases.forEach((canvas, k) => {
      canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
      canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
      const image = this.images[k];
      if (!image) return;
      const context = canvas.getContext("2d");
      const part = Math.min(canvas.width / large.width, canvas.height / large.height);
      const fitted = this.view.scale === null;
      const own = fitted ? Math.min(canvas.width / width, canvas.height / height) : scale * part;
      const x = canvas.width / 2 + (fitted ? -own * width / 2 : (left - large.width / 2) * part);
      const y = canvas.height / 2 + (fitted ? -own * height / 2 : (top - large.height / 2) * part);
      context.imageSmoothingEnabled = own * width < image.width;
      context.drawImage(image, Math.round(x), Math.round(y), own * width, own * height);
      Object.assign(canvas.dataset, { left: Math.round(x), top: Math.round(y), scale: own });
    });
  }
}

function held(part) {
  if (part === null) return "";
  return part > 0.995 ? "" : `; ${Math.floor(100 * part)} % of its contrast, the rest is not known`;
}

function missed({ holds, rms, mean, span }) {
  if (rms === null) return "none: nothing predicts it";
  const sign = mean < 0 ? "−" : "+";
  const lacks = holds !== null && holds < 0.9 ? ", with what is not known" : "";
  return `${percent(rms)} of white (rms)${lacks}, ${sign}${percent(Math.abs(mean))} in the mean; ` +
    `full colour at ${percent(span)}`;
}

function percent(part) {
  return `${Number((100 * part).toPrecision(2))} %`;
}
