// Joins the line, the pictures, the panels and the keys.

import { Line } from "./line.js";
import { Beside } from "./beside.js";
import { PictureView, drawHistogram, drawSharpness, sized } from "./picture.js";
import { press, put, showFrame, showSilence, showState } from "./panels.js";

const SPAN_MS = 60_000, AUTO_AFTER_MS = 5000;
const CLIPPED = 1, UNLIT = 2;
const element = (id) => document.getElementById(id);
let state = null;
let dark = false, touched = performance.now();
let figures = [], figuresOf = "";
let waitingPicture = null, raster = null;

const line = new Line(hear);
const view = new PictureView(element("camera"), (box) => line.ask({ do: "region", box }));
const beside = new Beside(view, element("comparison"));

new ResizeObserver(drawRaster).observe(element("projector"));

async function hear(message) {
  if (message.kind === "state") {
    state = message;
    if (state.activity === "ended") line.over = true;
    showState(state);
    autoDark();
  } else if (message.kind === "picture") {
    // Without "ready" nothing more comes: a page that is black costs nothing.
    if (dark) waitingPicture = message;
    else await showPicture(message);
  } else if (message.kind === "comparison") {
    await beside.show(message);
  } else if (message.kind === "projector") {
    await showRaster(message);
  } else if (message.kind === "refused") {
    put("standing", message.why);
  } else if (message.kind === "alive") {
    showSilence(state, message.silent_s);
  } else if (message.kind === "lost") {
    lose(message.since);
  } else if (message.kind === "back") {
    comeBack();
  }
}

// A room that is dark stays dark: the darkness says so itself, in faint red.
function lose(since) {
  const moment = new Date(since).toLocaleTimeString();
  put("stale", `no connection since ${moment}: what is shown is from then; trying again`);
  put("darkness", "no connection");
  element("activity").dataset.activity = "lost";
  document.body.classList.add("stale");
  document.querySelector("main").inert = element("helm").inert = true;
}

function comeBack() {
  put("stale", "");
  put("darkness", "");
  document.body.classList.remove("stale");
  document.querySelector("main").inert = element("helm").inert = false;
  if (state) element("activity").dataset.activity = state.activity;
  view.askAgain();
}

async function showPicture(head) {
  await view.show(head);
  if (!head.frame) beside.hide();
  drawHistogram(element("histogram"), head.histogram);
  put("clipped-share", percent(head.clipped));
  put("unlit-share", percent(head.unlit));
  put("levels", `mean ${["R", "G", "B"].map((name, k) => `${name} ${percent(head.mean[k])}`).join(", ")}`);
  const title = head.frame ? `step ${head.frame.step} as captured` : "camera";
  put("camera-title", title);
  element("camera").setAttribute("aria-label",
    `${title}: clipped ${percent(head.clipped)}, unlit ${percent(head.unlit)}`);
  showFrame(head.frame);
  const [, , width, height] = head.box;
  put("camera-note", `${width} × ${height} px${head.reduced > 1 ? `, shown ÷${head.reduced.toFixed(1)}` : ""}`);
  showScale();
  showFocus(head);
  line.ask({ do: "ready" });
}

function showFocus(head) {
  const now = performance.now();
  const key = JSON.stringify([head.box, head.frame?.pattern ?? state?.shown?.what, state?.camera.asked]);
  if (key !== figuresOf) figures = [];
  figuresOf = key;
  if (head.focus !== null) figures.push({ at: now, value: head.focus });
  figures = figures.filter((figure) => now - figure.at < SPAN_MS);
  const best = Math.max(...figures.map((figure) => figure.value));
  put("focus", head.focus === null ? "–" : head.focus.toPrecision(3));
  put("best", best > 0 ? `${best.toPrecision(3)} (now ${Math.round((100 * (head.focus ?? 0)) / best)} %)` : "–");
  drawSharpness(element("sharpness"), figures, now, SPAN_MS);
}

async function showRaster(message) {
  raster = await createImageBitmap(new Blob([message.files[0]], { type: "image/png" }));
  drawRaster();
  element("projector").dataset.what = message.what;
  put("expected", state?.shown ? "" : `the frame should show ${message.what}`);
}

function drawRaster() {
  if (!raster) return;
  const canvas = element("projector");
  const context = sized(canvas);
  const scale = Math.min(canvas.width / raster.width, canvas.height / raster.height);
  const [width, height] = [raster.width * scale, raster.height * scale];
  context.imageSmoothingEnabled = scale < 1;
  context.drawImage(raster, (canvas.width - width) / 2, (canvas.height - height) / 2, width, height);
}

function showScale() {
  const scale = view.scale;
  press(element("fit"), scale === null);
  press(element("pixels"), scale === 1);
  put("scale", scale === null ? "" : scale >= 1 ? `${scale} : 1` : `1 : ${1 / scale}`);
}

function percent(fraction) {
  const value = 100 * fraction;
  return `${value === 0 || value >= 10 ? value.toFixed(0) : value.toPrecision(2)} %`;
}

function darken() {
  dark = true;
  element("darkness").hidden = false;
}

function light() {
  dark = false;
  element("darkness").hidden = true;
  if (waitingPicture) {
    const picture = waitingPicture;
    waitingPicture = null;
    showPicture(picture);
  }
}

function autoDark() {
  if (!isPressed("auto")) return;
  if (state.activity !== "capturing") {
    if (dark) light();
  } else if (!dark && performance.now() - touched > AUTO_AFTER_MS) darken();
}

function isPressed(id) {
  return element(id).getAttribute("aria-pressed") === "true";
}

function toggle(id) {
  press(element(id), !isPressed(id));
  return isPressed(id);
}

function order(word) {
  line.ask({ do: word });
}

function show(what) {
  line.ask({ do: "show", what });
}

function look(source) {
  line.ask({ do: "look", source: state?.camera.source === source ? "off" : source });
}

function pauseOrGoOn() {
  if (!state) return;
  order(state.pausing || state.activity === "paused" ? "go-on" : "pause");
}

function step(factor) {
  view.step(factor);
  showScale();
}

function set(event) {
  event.preventDefault();
  document.activeElement.blur(); // so that the keys are commands again
  const [above, below] = element("exposure").value.split("/");
  const number = (id) => (element(id).value.trim() === "" ? null : Number(element(id).value));
  line.ask({
    do: "expose",
    exposure_s: Number(above) / Number(below ?? 1),
    aperture: number("aperture"),
    iso: number("iso"),
  });
}

const ACTIONS = {
  red: () => document.documentElement.classList.toggle("red", toggle("red")),
  auto: () => { toggle("auto"); touched = performance.now(); },
  blank: darken,
  help: () => element("keys").showModal(),
  clipped: () => view.mark(CLIPPED, toggle("clipped")),
  unlit: () => view.mark(UNLIT, toggle("unlit")),
  fit: () => { view.fit(); showScale(); },
  pixels: () => { view.zoom(1); showScale(); },
  forget: () => { figures = []; },
  live: () => look("live-view"),
  exposures: () => look("exposures"),
  show: () => show(element("pattern").value),
};
for (const word of ["take", "ask", "hand-over", "keep", "leave", "start", "start-new", "pause", "go-on", "stop", "aim", "rest"])
  ACTIONS[word] = () => order(word);
for (const [id, act] of Object.entries(ACTIONS)) element(id)?.addEventListener("click", act);
for (const button of document.querySelectorAll("[data-show]"))
  button.addEventListener("click", () => show(button.dataset.show));
element("settings").addEventListener("submit", set);
element("pattern")?.addEventListener("change", () => show(element("pattern").value));
element("light").addEventListener("input", (event) =>
  document.documentElement.style.setProperty("--light", String(event.target.value / 100)));
element("darkness").addEventListener("click", light);
element("camera").addEventListener("wheel", showScale);

const KEYS = {
  b: () => show("black"), w: () => show("white"), f: () => show("chart"),
  l: ACTIONS.live, e: ACTIONS.exposures, c: ACTIONS.clipped, u: ACTIONS.unlit,
  z: () => { view.toggle(); showScale(); }, p: pauseOrGoOn, S: ACTIONS.stop,
  r: ACTIONS.red, a: ACTIONS.auto, "?": ACTIONS.help,
  "+": () => step(2), "=": () => step(2), "-": () => step(0.5),
  ArrowLeft: () => view.pan(-1, 0), ArrowRight: () => view.pan(1, 0),
  ArrowUp: () => view.pan(0, -1), ArrowDown: () => view.pan(0, 1),
};
const REPEATED = new Set(["+", "=", "-", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]);
document.addEventListener("keydown", (event) => {
  touched = performance.now();
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.repeat && !REPEATED.has(event.key)) return;
  if (event.target.matches("input:not([type=range]), select") || element("keys").open) return;
  if (event.target.matches("input") && event.key.startsWith("Arrow")) return;
  if (event.key === " ") {
    event.preventDefault();
    if (dark) light();
    else darken();
  } else KEYS[event.key]?.();
});
document.addEventListener("pointerdown", () => { touched = performance.now(); });
setInterval(() => state && autoDark(), 1000);
