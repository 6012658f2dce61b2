// Draws panes with WebGL2: radiance is stored as half floats on the graphics card, and looks are computed while drawing.
// A pane is {image, reference, look, rect, origin, scale}: rect is its part of the canvas, origin the corner of the
// image, both in canvas pixels from the top left; scale is canvas pixels per image pixel.

const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D image, reference, colours;
uniform vec2 origin;
uniform float scale, height, gain, limit, epsilon;
uniform int mode, tone;
out vec4 colour;

vec3 toned(vec3 v) {
  v = clamp(v, 0.0, 1e6);
  if (tone == 1) v = v / (1.0 + v);
  if (tone == 2) v = ((0.9036 * v + 0.018) * v) / ((0.8748 * v + 0.354) * v + 0.14);
  v = min(v, 1.0);
  return mix(1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, 12.92 * v, vec3(lessThanEqual(v, vec3(0.0031308))));
}

float mean(vec3 v) { return (v.r + v.g + v.b) / 3.0; }

float error(vec4 x, vec3 y) {
  vec3 d = x.rgb - y;
  if (mode == 1) return mean(d);
  if (mode == 2) return mean(abs(d));
  if (mode == 3) return mean(d * d);
  if (mode == 4) return mean(abs(d) / (abs(y) + epsilon));
  if (mode == 5) return mean(2.0 * abs(d) / max(abs(x.rgb) + abs(y), 1e-30));
  return x.a;
}

void main() {
  vec2 at = (vec2(gl_FragCoord.x, height - gl_FragCoord.y) - origin) / scale;
  ivec2 size = textureSize(image, 0);
  int n = clamp(int(ceil(1.0 / scale - 1e-4)), 1, 16); // taps per side: a canvas pixel shows the mean of the pixels that it covers
  vec4 sum = vec4(0.0);
  float errors = 0.0, inside = 0.0;
  for (int j = 0; j < n; j++) {
    for (int i = 0; i < n; i++) {
      vec2 tap = (vec2(i, j) + 0.5) / float(n) - 0.5;
      ivec2 p = ivec2(floor(at + tap / scale * (n > 1 ? 1.0 : 0.0)));
      if (any(lessThan(p, ivec2(0))) || any(greaterThanEqual(p, size))) continue;
      vec4 y = texelFetch(reference, p, 0);
      if (y.a < 0.5) continue;
      vec4 x = texelFetch(image, p, 0);
      inside += 1.0;
      if (mode == 0) sum += x; else errors += error(x, y.rgb);
    }
  }
  colour = vec4(0.0);
  if (inside == 0.0) return;
  vec3 rgb;
  if (mode == 0) rgb = toned(gain * sum.rgb / inside);
  else {
    float v = clamp(errors / inside / limit, mode == 1 ? -1.0 : 0.0, 1.0);
    int index = int(floor(mode == 1 ? 127.5 + 127.0 * v : 254.0 * v + 0.5));
    rgb = texelFetch(colours, ivec2(index, mode == 1 ? 0 : 1), 0).rgb;
  }
  float share = inside / float(n * n);
  colour = vec4(rgb * share, share);
}`;

class GlPainter {
  // Whether there is WebGL2 on a graphics card. In software, a frame takes at least 0.15 s of the processor
  // (SwiftShader, 888 x 720, measured), and PlainPainter takes 0.01 s.
  static isFast() {
    const gl = document.createElement('canvas').getContext('webgl2', { failIfMajorPerformanceCaveat: true });
    if (!gl) return false;
    const known = gl.getExtension('WEBGL_debug_renderer_info');
    const name = gl.getParameter(known ? known.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
    gl.getExtension('WEBGL_lose_context')?.loseContext();
    return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
  }

  static create(canvas, colours) {
    const gl = canvas.getContext('webgl2', { antialias: false });
    return gl && new GlPainter(gl, colours);
  }

  constructor(gl, colours) {
    this.gl = gl;
    this.textures = new Map(); // by name of image, least recently used first
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.bindVertexArray(gl.createVertexArray());
    const names = ['image', 'reference', 'colours', 'origin', 'scale', 'height', 'gain', 'limit', 'epsilon', 'mode',
      'tone'];
    this.at = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
    names.slice(0, 3).forEach((name, unit) => gl.uniform1i(this.at[name], unit));
    gl.uniform1f(this.at.epsilon, colours.epsilon);
    const maps = new Uint8Array([...colours.signed, ...colours.unsigned]);
    this.texture(2, gl.RGB8, N_COLOURS, 2, gl.RGB, gl.UNSIGNED_BYTE, maps);
    gl.enable(gl.SCISSOR_TEST);
  }

  texture(unit, format, width, height, layout, type, data) {
    const gl = this.gl, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, layout, type, data);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }

  bind(unit, image) {
    const gl = this.gl, held = this.textures.get(image.name);
    this.textures.delete(image.name);
    gl.activeTexture(gl.TEXTURE0 + unit);
    if (held) gl.bindTexture(gl.TEXTURE_2D, held.texture);
    const texture = held?.texture
      ?? this.texture(unit, gl.RGBA16F, image.width, image.height, gl.RGBA, gl.HALF_FLOAT, image.half);
    this.textures.set(image.name, { texture, bytes: 8 * image.width * image.height });
  }

  paint(panes) {
    const gl = this.gl, { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    gl.scissor(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.uniform1f(this.at.height, height);
    for (const { image, reference, look, rect, origin, scale } of panes) {
      this.bind(0, image);
      this.bind(1, reference);
      gl.scissor(rect.x, height - rect.y - rect.height, rect.width, rect.height);
      gl.uniform2f(this.at.origin, origin.x, origin.y);
      gl.uniform1f(this.at.scale, scale);
      gl.uniform1f(this.at.gain, look.gain);
      gl.uniform1f(this.at.limit, look.limit);
      gl.uniform1i(this.at.mode, MODES.indexOf(look.mode));
      gl.uniform1i(this.at.tone, TONES.indexOf(look.tone));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    this.forget(panes);
  }

  // Keeps the textures of these panes, and as many others as fit.
  forget(panes) {
    const shown = new Set(panes.flatMap((pane) => [pane.image.name, pane.reference.name]));
    let held = 0;
    for (const each of this.textures.values()) held += each.bytes;
    for (const [name, each] of this.textures) {
      if (held <= MOST_BYTES) break;
      if (shown.has(name)) continue;
      this.gl.deleteTexture(each.texture);
      this.textures.delete(name);
      held -= each.bytes;
    }
  }
}
