// What one pixel holds: its class, its shares of the components, its direct light against pitch.

const SVG = "http://www.w3.org/2000/svg";
const COLOURS = ["red", "green", "blue"];
const DASHES = ["", "6 3", "2 3"];

class Probe {
  constructor(aside, canvases) {
    this.aside = aside;
    this.canvases = canvases;
    this.light = null;
    this.row = Math.floor(facts.remix.height / 2);
    this.column = Math.floor(facts.remix.width / 2);
    for (const canvas of canvases) {
      canvas.addEventListener("click", (event) => this.click(canvas, event));
      canvas.addEventListener("keydown", (event) => this.key(event));
    }
    this.cross();
    onceSeen(aside, () => this.fill().catch(failed));
  }

  async fill() {
    const [components, white, deviations, direct, errors, flags] = await lightOf(
      "components", "white", "deviations", "direct", "direct-deviations", "flags");
    this.light = { components, white, deviations, direct, errors, flags };
    this.show();
  }

  click(canvas, event) {
    const box = canvas.getBoundingClientRect();
    const { height, width } = facts.remix;
    this.move(
      Math.floor(((event.clientY - box.top) / box.height) * height),
      Math.floor(((event.clientX - box.left) / box.width) * width),
    );
  }

  key(event) {
    const steps = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
    const step = steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const far = event.shiftKey ? 10 : 1;
    this.move(this.row + far * step[0], this.column + far * step[1]);
  }

  move(row, column) {
    this.row = Math.min(Math.max(row, 0), facts.remix.height - 1);
    this.column = Math.min(Math.max(column, 0), facts.remix.width - 1);
    this.cross();
    if (this.light === null) this.fill().catch(failed);
    else this.show();
  }

  cross() {
    const { height, width } = facts.remix;
    for (const canvas of this.canvases) {
      const cross = canvas.parentElement.querySelector(".cross");
      cross.style.left = `${(100 * (this.column + 0.5)) / width}%`;
      cross.style.top = `${(100 * (this.row + 0.5)) / height}%`;
    }
  }

  show() {
    const { block } = facts.remix;
    const place = block === 1
      ? `Pixel in row ${this.row}, column ${this.column}`
      : `Mean of the ${block} × ${block} pixels from row ${this.row * block}, ` +
        `column ${this.column * block}`;
    this.aside.querySelector(".place").textContent = `${place}: ${this.state()}.`;
    this.shares();
    const plot = this.aside.querySelector(".plot");
    plot.replaceChildren();
    if (facts.pitches.length) {
      const errors = facts.direct_deviations ? this.atCross(this.light.errors) : null;
      drawPlot(plot, this.atCross(this.light.direct), errors);
    }
  }

  state() {
    const flag = this.light.flags[this.row * facts.remix.width + this.column];
    if (flag & 1) return "saturated, not measured";
    if (flag & 2) return "measured, partly saturated";
    if (flag & 4) return "unlit, or partly so";
    return "measured";
  }

  shares() {
    const { width, height } = facts.remix;
    const pixel = this.row * width + this.column;
    const white = [0, 1, 2].map((c) => this.light.white[3 * pixel + c]);
    const whole = white[0] + white[1] + white[2];
    const rows = facts.components.map(({ name, colour }, k) => {
      const at = k * width * height + pixel;
      const values = [0, 1, 2].map((c) => this.light.components[3 * at + c]);
      const share = (values[0] + values[1] + values[2]) / whole;
      // Root mean square over three colours taken as independent: √3 of it for their sum.
      const error = this.light.deviations.length
        ? (Math.sqrt(3) * this.light.deviations[at]) / whole : null;
      return tableRow(name, colour, values, said(share, error));
    });
    rows.push(tableRow("white light", null, white, ""));
    this.aside.querySelector("tbody").replaceChildren(...rows);
  }

  // Of a block of all pitches, by colour.
  atCross(values) {
    const { height, width, block, layers } = facts.pitch;
    const ratio = block / facts.remix.block;
    const row = Math.min(Math.floor(this.row / ratio), height - 1);
    const column = Math.min(Math.floor(this.column / ratio), width - 1);
    return COLOURS.map((_, c) => Array.from({ length: layers }, (__, k) =>
      values[3 * ((k * height + row) * width + column) + c]));
  }
}

function said(share, error) {
  if (!Number.isFinite(share)) return "–";
  const percent = (100 * share).toFixed(1).replace("-", "−");
  return error === null ? `${percent} %` : `${percent} ± ${(100 * error).toFixed(1)} %`;
}

function tableRow(name, colour, values, share) {
  const row = document.createElement("tr");
  const head = document.createElement("th");
  head.scope = "row";
  if (colour !== null) {
    const chip = document.createElement("span");
    chip.className = "chip";
    chip.style.background = colour;
    head.append(chip);
  }
  head.append(name);
  row.append(head);
  for (const text of [...values.map((v) => v.toFixed(4).replace("-", "−")), share]) {
    const cell = document.createElement("td");
    cell.textContent = text;
    row.append(cell);
  }
  return row;
}

function node(parent, kind, attributes, text) {
  const made = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

function drawPlot(svg, lines, errors) {
  const left = 46, right = 430, top = 12, bottom = 200;
  const pitches = facts.pitches.map(({ px }) => px);
  const [low, high] = [Math.min(...pitches), Math.max(...pitches)];
  const bars = (errors ?? lines.map((line) => line.map(() => 0))).flat();
  const largest = Math.max(...lines.flat().map((v, i) => v + bars[i]), 1e-6);
  const smallest = Math.min(0, ...lines.flat().map((v, i) => v - bars[i]));
  const x = (px) => left + 8 + ((right - left - 16) * (px - low)) / Math.max(high - low, 1);
  const y = (value) => bottom - ((bottom - top) * (value - smallest)) / (largest - smallest);
  for (const value of new Set([smallest, 0, largest / 2, largest])) {
    node(svg, "line", { x1: left, x2: right, y1: y(value), y2: y(value), class: "grid" });
    node(svg, "text", { x: left - 5, y: y(value) + 4, "text-anchor": "end" },
      value === 0 ? "0" : value.toPrecision(2).replace("-", "−"));
  }
  for (const px of new Set([low, pitches[Math.floor(pitches.length / 2)], high])) {
    node(svg, "text", { x: x(px), y: bottom + 17, "text-anchor": "middle" }, String(px));
  }
  node(svg, "text", { x: (left + right) / 2, y: bottom + 34, "text-anchor": "middle" },
    "pitch in projector pixels");
  lines.forEach((line, c) => drawLine(svg, line, errors?.[c], x, y, c));
  const end = (c, k) => lines[c].at(k).toPrecision(3) +
    (errors === null ? "" : ` ± ${errors[c].at(k).toPrecision(2)}`);
  const ends = COLOURS.map((name, c) => `${name} ${end(c, 0)} to ${end(c, -1)}`);
  svg.setAttribute("aria-label",
    `Direct light from pitch ${pitches[0]} to ${pitches.at(-1)} px: ${ends.join(", ")}.`);
}

function drawLine(svg, line, errors, x, y, c) {
  const pitches = facts.pitches.map(({ px }) => px);
  const paint = { stroke: facts.colours[c], fill: "none" };
  const families = facts.pitches.map(({ family }) => family);
  for (const family of new Set(families)) {
    const own = line.map((_, k) => k).filter((k) => families[k] === family);
    const points = own.map((k) => `${x(pitches[k])},${y(line[k])}`).join(" ");
    node(svg, "polyline", { ...paint, points, "stroke-dasharray": DASHES[c] });
  }
  line.forEach((value, k) => {
    const dot = { cx: x(pitches[k]), cy: y(value), fill: facts.colours[c] };
    // Hollow: not all of its frames were proven.
    if (facts.pitches[k].whole) node(svg, "circle", { ...dot, r: 2 });
    else node(svg, "circle", { ...dot, r: 3.5, fill: "#ffffff", stroke: facts.colours[c], class: "unproven" });
    if (errors === undefined) return;
    const [x1, y1, y2] = [x(pitches[k]), y(value - errors[k]), y(value + errors[k])];
    node(svg, "line", { ...paint, x1, x2: x1, y1, y2, class: "error" });
  });
}
