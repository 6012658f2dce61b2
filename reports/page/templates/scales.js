// Scales: from values to pixels, with their ticks.

const ZERO_SLOT = 22; // pixels at the low end of a log scale for costs of zero

// Log scale over positive values; zeros have a separate slot at the low end.
function logScale(values, [from, to], margin = 1.5) {
  const positive = values.filter((value) => value > 0);
  const hasZero = values.some((value) => value === 0);
  const low = (positive.length ? Math.min(...positive) : 1) / margin;
  const high = (positive.length ? Math.max(...positive) : 1) * margin;
  const start = from + (hasZero ? ZERO_SLOT * Math.sign(to - from) : 0);
  const at = (value) =>
    value === 0 ? from + (ZERO_SLOT / 3) * Math.sign(to - from)
      : start + ((to - start) * Math.log(value / low)) / Math.log(high / low);
  const { major, minor } = positive.length ? logTicks(low, high, Math.abs(to - start)) : { major: [], minor: [] };
  const apart = major.filter((value) => !hasZero || Math.abs(at(value) - at(0)) > 30); // a label's width away from the label of zero
  return { at, low, high, hasZero, major: hasZero ? [0, ...apart] : apart, minor };
}

// Decades if there are at least two; else 1, 2 and 5; else values between; as many as there is room for.
function logTicks(low, high, pixels) {
  const first = Math.floor(Math.log10(low));
  const last = Math.ceil(Math.log10(high));
  const steps = (digits) => {
    const found = [];
    for (let power = first; power <= last; power++) {
      for (const digit of digits) {
        const value = Number(`${digit}e${power}`);
        if (value >= low && value <= high) found.push(value);
      }
    }
    return found;
  };
  const minor = steps([1, 2, 3, 4, 5, 6, 7, 8, 9]);
  const most = Math.max(2, pixels / 48);
  for (const digits of [[1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 5], [1, 3], [1]]) {
    const major = steps(digits);
    const closest = Math.min(...major.slice(1).map((value, i) => Math.log(value / major[i])));
    const gap = (closest / Math.log(high / low)) * pixels;
    if (major.length <= most && gap > 30) return { major, minor };
  }
  const decades = steps([1]);
  const every = Math.ceil(decades.length / most);
  return { major: decades.filter((_, i) => i % every === 0), minor: decades.length > 12 ? [] : minor };
}

// Linear scale for metrics that are higher for better images.
function linearScale(values, [from, to]) {
  let low = Math.min(...values);
  let high = Math.max(...values);
  const room = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1;
  low -= room;
  high += room;
  const step = niceStep((high - low) / 4);
  const major = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) major.push(Number((i * step).toPrecision(6)));
  return { at: (value) => from + ((to - from) * (value - low)) / (high - low), low, high, major, minor: [] };
}

function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((digit) => digit * power >= rough);
}

// A row for each name, the first at the top.
function nameScale(names, [bottom, top]) {
  const step = (bottom - top) / names.length;
  return { at: (row) => top + (row + 0.5) * step, names, major: names.map((_, row) => row), minor: [] };
}
