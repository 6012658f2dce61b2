// Images as the page stores them: base64 of deflated planes of half floats (`packed` in reports/page/payload.py).

// The number of each half float, by its bits.
const HALF = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits >> 15 ? -1 : 1;
    if (exponent === 31) table[bits] = fraction ? NaN : sign * Infinity;
    else table[bits] = sign * (exponent ? (1 + fraction / 1024) * 2 ** (exponent - 15) : fraction * 2 ** -24);
  }
  return table;
})();

// Bits of half floats, R G B A of each pixel, from the bytes of planes: the inverse of `packed`.
function unpacked(bytes, width, height) {
  const area = width * height, n = 4 * area, half = new Uint16Array(n);
  for (let plane = 0; plane < 4; plane++) {
    for (let y = 0, i = plane * area; y < height; y++) {
      let sum = 0;
      for (let x = 0; x < width; x++, i++) {
        const folded = (bytes[i] << 8) | bytes[n + i];
        sum += (folded >> 1) ^ -(folded & 1);
        const at = 4 * (y * width + x) + plane;
        half[at] = y ? sum + half[at - 4 * width] : sum;
      }
    }
  }
  for (let at = 0; at < n; at += 4) {
    half[at] += half[at + 1];
    half[at + 2] += half[at + 1];
  }
  return half;
}
