// Σ gain · component in linear light on the graphics card, exposed and encoded for the screen.

const VERTEX = `#version 300 es
void main() {
  // One triangle that covers everything.
  gl_Position = vec4(4.0 * float(gl_VertexID % 2) - 1.0, 4.0 * float(gl_VertexID / 2) - 1.0, 0, 1);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
precision highp usampler2D;
uniform sampler2DArray components;
uniform sampler2DArray deviations;
uniform usampler2D flags;
uniform sampler2D ramp;
uniform int layers;
uniform float left[32];
uniform float right[32];
uniform float exposure;
uniform float border;
uniform bool soft;
uniform int overlay;       // -2 none, -1 saturated and unlit, k: uncertainty of component k
uniform float uncertain;   // standard error at the upper end of the colour map
uniform vec3 marks[2];     // saturated, unlit
uniform ivec2 size;
out vec4 screen;

vec3 encoded(vec3 light) {
  light = max(light, 0.0);
  if (soft) light = light * (1.0 + light / 16.0) / (1.0 + light);
  light = min(light, 1.0);
  vec3 curve = 1.055 * pow(max(light, 1e-9), vec3(1.0 / 2.4)) - 0.055;
  return mix(curve, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
}

void main() {
  ivec2 place = ivec2(int(gl_FragCoord.x), size.y - 1 - int(gl_FragCoord.y));
  uint flag = texelFetch(flags, place, 0).r;
  bool onLeft = float(place.x) < border;
  vec3 light = vec3(0.0);
  for (int k = 0; k < layers; k++) {
    light += (onLeft ? left[k] : right[k]) * texelFetch(components, ivec3(place, k), 0).rgb;
  }
  vec3 colour = encoded(light * exposure);
  if (overlay >= 0) {
    float level = texelFetch(deviations, ivec3(place, overlay), 0).r / uncertain;
    colour = texelFetch(ramp, ivec2(int(clamp(level, 0.0, 1.0) * 255.0 + 0.5), 0), 0).rgb;
  }
  if (overlay == -1 && (flag & 4u) != 0u) colour = marks[1];
  if ((flag & 1u) != 0u || (overlay == -1 && (flag & 2u) != 0u)) colour = marks[0];
  screen = vec4(floor(255.0 * colour + 0.5) / 255.0, 1.0);
}`;

class Mixer {
  constructor(canvas, components, flags) {
    const { height, width, layers } = facts.remix;
    canvas.height = height;
    canvas.width = width;
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
    if (this.gl === null) throw new Error("no WebGL2");
    const gl = this.gl;
    this.program = linked(gl);
    gl.useProgram(this.program);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    texture(gl, 0, gl.TEXTURE_2D_ARRAY);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGB32F, width, height, layers, 0, gl.RGB, gl.FLOAT,
      components);
    texture(gl, 1, gl.TEXTURE_2D_ARRAY);
    texture(gl, 2, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8UI, width, height, 0, gl.RED_INTEGER, gl.UNSIGNED_BYTE,
      flags);
    texture(gl, 3, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE,
      new Uint8Array(facts.ramp));
    ["components", "deviations", "flags", "ramp"].forEach((name, unit) => {
      gl.uniform1i(this.place(name), unit);
    });
    gl.uniform1i(this.place("layers"), layers);
    gl.uniform1f(this.place("uncertain"), facts.uncertain ?? 1);
    gl.uniform3fv(this.place("marks"), facts.marks.flat().map((value) => value / 255));
    gl.uniform2i(this.place("size"), width, height);
    if (gl.getError() !== gl.NO_ERROR) throw new Error("the light does not fit the graphics card");
  }

  // Standard errors of the components, which only their overlay needs.
  take(deviations) {
    const { height, width, layers } = facts.remix;
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE1);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.R32F, width, height, layers, 0, gl.RED, gl.FLOAT,
      deviations);
  }

  place(name) {
    return this.gl.getUniformLocation(this.program, name);
  }

  draw(mix) {
    const gl = this.gl;
    gl.uniform1fv(this.place("left"), mix.gains.A);
    gl.uniform1fv(this.place("right"), mix.gains.B);
    gl.uniform1f(this.place("exposure"), facts.display_gain * 2 ** mix.exposure);
    gl.uniform1f(this.place("border"), mix.wipe * facts.remix.width);
    gl.uniform1i(this.place("soft"), mix.tone === "soft" ? 1 : 0);
    gl.uniform1i(this.place("overlay"), mix.overlay);
    gl.viewport(0, 0, facts.remix.width, facts.remix.height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

function texture(gl, unit, target) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(target, gl.createTexture());
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(target, name, gl.NEAREST);
  }
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(gl.getProgramInfoLog(program) || "the shader does not link");
  }
  return program;
}
