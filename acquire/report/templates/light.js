// The light of the page: planes of bytes of 32-bit floats, the highest first, deflated, base64.

const facts = JSON.parse(document.getElementById("facts").textContent);

async function inflated(name) {
  const text = atob(document.getElementById(`light-${name}`).textContent.trim());
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

async function allLight() {
  const { remix, pitch } = facts;
  const fine = remix.height * remix.width;
  const coarse = pitch.height * pitch.width * 3 * pitch.layers;
  const uncertain = facts.uncertain === null ? 0 : fine * remix.layers;
  const [components, white, deviations, direct, global, flags] = await Promise.all([
    floats("components", fine * 3 * remix.layers),
    floats("white", fine * 3),
    floats("deviations", uncertain),
    floats("direct", coarse),
    floats("global", coarse),
    inflated("flags"),
  ]);
  return { components, white, deviations, direct, global, flags };
}
