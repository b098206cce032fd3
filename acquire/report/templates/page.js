// Unpacks the light and starts what needs it; says so where the browser cannot.

async function start() {
  const section = document.getElementById("live");
  const problem = document.getElementById("live-problem");
  const light = await allLight();
  const canvases = [];
  try {
    new Remix(section, light);
    canvases.push(section.querySelector("canvas"));
    section.classList.add("ready");
  } catch (error) {
    problem.textContent = `The remix needs WebGL2, which this browser does not offer here ` +
      `(${error.message}). \`lumisplit remix\` makes the same mixes as files.`;
  }
  const scrubber = document.getElementById("scrubber");
  if (scrubber !== null) {
    new Scrubber(scrubber, light);
    scrubber.hidden = false;
    canvases.push(...scrubber.querySelectorAll("canvas"));
  }
  new Probe(document.getElementById("probe"), canvases, light);
  document.getElementById("probe").hidden = false;
  document.documentElement.dataset.live = section.classList.contains("ready") ? "ready" : "partly";
}

start().catch((error) => {
  document.getElementById("live-problem").textContent =
    `The light in this page cannot be unpacked (${error.message}). A browser of 2023 or newer can.`;
  document.documentElement.dataset.live = "failed";
});
