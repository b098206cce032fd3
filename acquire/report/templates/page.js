// Draws the remix first and starts what else needs the light; says so where the browser cannot.

async function start() {
  const section = document.getElementById("live");
  const problem = document.getElementById("live-problem");
  const [components, flags] = await lightOf("components", "flags");
  const canvases = [];
  let remix = null;
  try {
    remix = new Remix(section, components, flags);
    canvases.push(section.querySelector("canvas"));
    section.classList.add("ready");
    performance.mark("first mix drawn");
  } catch (error) {
    problem.textContent = `The remix needs WebGL2, which this browser does not offer here ` +
      `(${error.message}). \`lumisplit remix\` makes the same mixes as files.`;
  }
  const scrubber = document.getElementById("scrubber");
  if (scrubber !== null) {
    scrubber.hidden = false;
    new Scrubber(scrubber, remix);
    canvases.push(...scrubber.querySelectorAll("canvas"));
  }
  document.getElementById("probe").hidden = false;
  new Probe(document.getElementById("probe"), canvases);
  document.documentElement.dataset.live = remix === null ? "partly" : "ready";
}

function failed(error) {
  document.getElementById("live-problem").textContent =
    `The light in this page cannot be unpacked (${error.message}). A browser of 2023 or newer can.`;
  document.documentElement.dataset.live = "failed";
}

start().catch(failed);
