// What is known, in words and numbers.

const element = (id) => document.getElementById(id);
const DOING = {
  opening: "opening the bench", aiming: "aiming", resting: "devices let go",
  capturing: "capturing", paused: "paused", ended: "ended",
};

export function showState(state) {
  const commands = state.holder === state.you;
  showActivity(state);
  showHelm(state, commands);
  showProjector(state);
  showCamera(state, commands);
  showPlan(state);
  showNotes(state);
  enable(state, commands);
}

function showActivity(state) {
  let text = DOING[state.activity];
  if (state.activity === "capturing" && state.stopping) text = "stopping after this frame";
  else if (state.activity === "capturing" && state.pausing) text = "pausing after this frame";
  const { progress } = state;
  if (state.activity === "ended" && progress)
    text = progress.done === progress.total ? "ended: complete" : "ended: stopped";
  put("activity", text);
  element("activity").dataset.activity = state.activity;
  document.title = progress ? `${progress.done}/${progress.total} – lumisplit` : "bench – lumisplit";
}

function showHelm(state, commands) {
  const asking = state.asking !== null;
  let text = commands ? "you command" : state.holder === null ? "nobody commands" : `viewer ${state.holder} commands, you watch`;
  if (asking && commands) text = `viewer ${state.asking} asks for control`;
  if (asking && state.asking === state.you) text = "asked; control comes after 15 s of silence";
  put("standing", `${text} · ${state.viewers} ${state.viewers === 1 ? "viewer" : "viewers"}`);
  element("take").hidden = state.holder !== null;
  element("ask").hidden = commands || state.holder === null || asking;
  element("hand-over").hidden = element("keep").hidden = !(commands && asking);
  element("leave").hidden = !commands || asking || state.viewers < 2;
}

function showProjector(state) {
  const follows = { capturing: "follows the plan", paused: "black", resting: "off", ended: "off" };
  put("shown", state.shown?.what ?? follows[state.activity] ?? "–");
  element("shown").dataset.sha256 = state.shown?.raster_sha256 ?? "";
  element("shown").title = state.shown?.raster_sha256 ? `sha256 ${state.shown.raster_sha256}` : "";
  for (const button of document.querySelectorAll("[data-show]"))
    press(button, state.shown?.what === button.dataset.show);
}

let askedBefore = "";
function showCamera(state) {
  const { asked, read_back, source } = state.camera;
  press(element("live"), source === "live-view");
  press(element("exposures"), source === "exposures");
  put("read-back", read_back ? inWords(read_back) : "–");
  const differs = asked && read_back && JSON.stringify(asked) !== JSON.stringify(read_back);
  element("read-back").classList.toggle("differs", Boolean(differs));
  const text = JSON.stringify(asked);
  if (asked && text !== askedBefore) {
    askedBefore = text;
    element("exposure").value = time(asked.exposure_s);
    element("aperture").value = asked.aperture ?? "";
    element("iso").value = asked.iso ?? "";
  }
}

function showPlan(state) {
  const { progress } = state;
  element("done").max = progress?.total ?? 1;
  element("done").value = progress?.done ?? 0;
  put("count", progress ? `${progress.done} of ${progress.total}` : "none");
  put("session", state.session ? `session ${state.session}` : "");
  const runs = ["capturing", "paused"].includes(state.activity);
  value("left", runs && progress?.left_s > 0 && timeLeft(progress.left_s, state.activity));
  value("pace", runs && progress?.frame_s && `${(60 / progress.frame_s).toFixed(1)} frames a minute`);
  const free = state.free_bytes;
  const needed = progress?.needed_bytes ? `, ${bytes(progress.needed_bytes)} to come` : "";
  value("disk", free != null && `${bytes(free)} free${needed}`);
  element("disk").classList.toggle("differs", Boolean(progress && free != null && progress.needed_bytes > free));
}

// A capture of which nothing is heard may hang, and may only expose for long.
export function showSilence(state, silent_s) {
  const { frame_s } = state?.progress ?? {};
  const late = state?.activity === "capturing" && silent_s > 10 + 3 * (frame_s ?? 10);
  put("silence", late ? `nothing heard of the bench for ${duration(silent_s)}` : "");
}

export function showFrame(frame) {
  value("frame", frame && `${frame.step}: ${frame.pattern}, ${bytes(frame.size_bytes)}`);
  element("frame").title = frame?.raster_sha256 ? `raster sha256 ${frame.raster_sha256}` : "";
  value("exposed", frame?.settings && inWords(frame.settings));
  const { measured, expected } = frame?.light ?? {};
  value("frame-light", measured != null && `${measured.toFixed(3)} of white, due ${expected.toFixed(3)}`);
  value("proof", frame && proof(frame.proofs));
  element("proof").classList.toggle("differs", Boolean(frame?.proofs.wrong.length));
}

function proof({ judged, retaken, wrong }) {
  if (!judged) return "judged when its pitch is complete";
  const again = retaken ? `; ${retaken} taken again` : "";
  return `${judged} frames judged, ${wrong.length ? wrong.join(", ") : "each shows its pattern"}${again}`;
}

function timeLeft(seconds, activity) {
  if (activity !== "capturing") return duration(seconds);
  const end = new Date(Date.now() + 1000 * seconds);
  const day = seconds > 43_200 ? { weekday: "short" } : {};
  return `${duration(seconds)}, until ${end.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", ...day })}`;
}

// A row without a value is left out.
function value(id, text) {
  element(id).classList.toggle("empty", !text);
  put(id, text || "–");
}

let notesBefore = "";
function showNotes(state) {
  const notes = [...state.notes];
  if (state.trouble) notes.push({ at_s: Date.now() / 1000, text: state.trouble, is_error: true });
  const text = JSON.stringify(notes.map((note) => note.text));
  if (text === notesBefore) return;
  notesBefore = text;
  element("notes").replaceChildren(...notes.reverse().map((note) => {
    const item = document.createElement("li");
    const when = document.createElement("time");
    when.textContent = new Date(note.at_s * 1000).toLocaleTimeString();
    item.append(when, note.text);
    item.classList.toggle("error", note.is_error);
    return item;
  }));
}

function enable(state, commands) {
  const aiming = commands && state.activity === "aiming";
  const capturing = ["capturing", "paused"].includes(state.activity);
  for (const control of document.querySelectorAll(".aim button, .aim select, .aim input")) control.disabled = !aiming;
  const mayAim = document.body.dataset.aim === "1" && !capturing;
  element("camera-panel").hidden = !mayAim;
  for (const row of document.querySelectorAll("#projector-panel .aim")) row.hidden = !mayAim;
  if (aiming) element("live").disabled = !state.camera.has_live_view;
  const canStart = document.body.dataset.start === "1" && ["aiming", "resting"].includes(state.activity);
  const complete = state.progress && state.progress.done === state.progress.total;
  const begun = Boolean(state.progress?.done);
  put("start", begun ? `go on from frame ${state.progress.done}` : "start");
  visible("start", canStart && !complete, commands);
  visible("start-new", canStart && begun, commands);
  visible("pause", capturing && !state.pausing && state.activity !== "paused", commands && !state.stopping);
  visible("go-on", capturing && (state.pausing || state.activity === "paused"), commands);
  visible("stop", capturing, commands && !state.stopping);
  if (element("aim")) {
    visible("aim", state.activity === "resting", commands);
    visible("rest", state.activity === "aiming", commands);
  }
}

function visible(id, shown, enabled) {
  element(id).hidden = !shown;
  element(id).disabled = !enabled;
}

export function put(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}

export function press(button, on) {
  button.setAttribute("aria-pressed", String(Boolean(on)));
}

export function time(seconds) {
  return seconds < 0.3 ? `1/${Number((1 / seconds).toPrecision(4))}` : String(seconds);
}

function inWords({ exposure_s, aperture, iso }) {
  return [`${time(exposure_s)} s`, aperture && `f/${aperture}`, iso && `ISO ${iso}`].filter(Boolean).join(", ");
}

function duration(seconds) {
  const whole = Math.round(seconds);
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor((whole % 3600) / 60)];
  const rest = String(whole % 60).padStart(2, "0");
  return hours ? `${hours} h ${String(minutes).padStart(2, "0")} min` : `${minutes} min ${rest} s`;
}

function bytes(count) {
  return count >= 1e9 ? `${(count / 1e9).toFixed(1)} GB` : count >= 1e6 ? `${(count / 1e6).toFixed(1)} MB` : `${(count / 1e3).toFixed(0)} kB`;
}
