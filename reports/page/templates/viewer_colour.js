// From radiance to the colour of a pixel: tone curves, error modes, colour maps. viewer_gl.js does the same in GLSL.
// A look is {mode, gain, tone, limit}: image or error, factor of the exposure, tone curve, end of the error scale.

const TONES = ['srgb', 'reinhard', 'aces'];
const MODES = ['image', 'signed', 'absolute', 'squared', 'relative', 'smape', 'flip'];
const N_COLOURS = 255; // of a map; an odd number has a centre
const CURVE = Float32Array.from({ length: 16385 }, (_, i) => 255 * encoded(i / 16384));

// The sRGB curve, IEC 61966-2-1.
function encoded(v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
}

// A channel of radiance, exposed, in [0, 1] before the sRGB curve.
function toned(v, tone) {
  v = Math.min(Math.max(v, 0), 1e6);
  if (tone === 'reinhard') v = v / (1 + v);
  if (tone === 'aces') v = ((0.9036 * v + 0.018) * v) / ((0.8748 * v + 0.354) * v + 0.14); // Narkowicz 2015
  return Math.min(v, 1);
}

// The error of the pixel that begins at `at`; x is the image, y the reference, both as bits of half floats.
function errorAt(mode, x, y, at, epsilon) {
  if (mode === 'flip') return HALF[x[at + 3]];
  let sum = 0;
  for (let c = at; c < at + 3; c++) {
    const b = HALF[y[c]], d = HALF[x[c]] - b;
    if (mode === 'signed') sum += d;
    else if (mode === 'squared') sum += d * d;
    else if (mode === 'absolute') sum += Math.abs(d);
    else if (mode === 'relative') sum += Math.abs(d) / (Math.abs(b) + epsilon);
    else if (d !== 0) sum += (2 * Math.abs(d)) / (Math.abs(HALF[x[c]]) + Math.abs(b)); // SMAPE
  }
  return sum / 3;
}

// The index of an error in its colour map.
function colourIndex(error, look) {
  const v = Math.min(Math.max(error / look.limit, look.mode === 'signed' ? -1 : 0), 1);
  return Math.floor(look.mode === 'signed' ? 127.5 + 127 * v : 254 * v + 0.5);
}

// Colours of a rectangle of an image, as pixels of a canvas; transparent off the mask.
function coloured(image, reference, look, colours, x0 = 0, y0 = 0, width = image.width, height = image.height) {
  const pixels = new ImageData(width, height), out = pixels.data;
  const x = image.half, y = reference.half;
  const map = look.mode === 'signed' ? colours.signed : colours.unsigned;
  for (let row = 0, o = 0; row < height; row++) {
    for (let column = 0; column < width; column++, o += 4) {
      const at = 4 * ((y0 + row) * image.width + x0 + column);
      if (HALF[y[at + 3]] < 0.5) continue;
      if (look.mode === 'image') {
        for (let c = 0; c < 3; c++) {
          out[o + c] = CURVE[Math.round(16384 * toned(look.gain * HALF[x[at + c]], look.tone))];
        }
      } else {
        const i = 3 * colourIndex(errorAt(look.mode, x, y, at, colours.epsilon), look);
        for (let c = 0; c < 3; c++) out[o + c] = map[i + c];
      }
      out[o + 3] = 255;
    }
  }
  return pixels;
}
