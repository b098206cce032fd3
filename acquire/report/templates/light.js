// The light of the page: planes of bytes of 32-bit floats, the highest first, deflated, base64.

const facts = JSON.parse(document.getElementById("facts").textContent);
const unpacking = new Map();
const parsed = new Promise((done) => {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", done);
  else done();
});

async function inflated(name) {
  const id = `light-${name}`;
  // What is not needed at once stands after the script.
  if (document.getElementById(id) === null) await parsed;
  const text = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function floats(name, count) {
  const planes = await inflated(name);
  if (count === 0) return new Float32Array(0);
  const bits = new Uint32Array(count);
  const kept = planes.length / count;
  for (let plane = 0; plane < kept; plane++) {
    const shift = 24 - 8 * plane;
    const start = plane * count;
    for (let i = 0; i < count; i++) bits[i] |= planes[start + i] << shift;
  }
  return new Float32Array(bits.buffer);
}

function unpacked(name) {
  const { remix, pitch } = facts;
  const fine = remix.height * remix.width;
  const coarse = pitch.height * pitch.width * 3 * pitch.layers;
  switch (name) {
    case "components": return floats(name, fine * 3 * remix.layers);
    case "white": return floats(name, fine * 3);
    case "deviations": return floats(name, facts.uncertain === null ? 0 : fine * remix.layers);
    case "direct-deviations": return floats(name, facts.direct_deviations ? coarse : 0);
    case "direct":
    case "global": return floats(name, coarse);
    default: return inflated(name);
  }
}

// Unpacked once, when it is first wanted.
function lightOf(...names) {
  return Promise.all(names.map((name) => {
    if (!unpacking.has(name)) unpacking.set(name, unpacked(name));
    return unpacking.get(name);
  }));
}

// Calls once, when the element is about to be seen.
function onceSeen(element, act) {
  const watch = new IntersectionObserver((entries) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    watch.disconnect();
    act();
  }, { rootMargin: "200px" });
  watch.observe(element);
}
