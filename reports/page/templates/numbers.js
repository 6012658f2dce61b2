// Numbers as in print: 0.0123, 1240, 1.20×10⁻⁶; – for null. The same as `format_number` in reports/style.py.

const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

function number(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  if (!Number.isFinite(value)) return "∞";
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const power = Number(exponent);
  if (power >= -4 && power < 6) return minus(value.toFixed(Math.max(0, digits - 1 - power)));
  return minus(mantissa) + "×10" + raised(power);
}

// A tick without trailing digits: 0.05, 2000, 10⁻⁷.
function tick(value) {
  const mantissa = value.toExponential(2).split("e")[0].replace(/\.?0+$/, "");
  return number(value, mantissa.replace(/[.-]/g, "").length).replace(/^1×/, "");
}

function raised(power) {
  return (power < 0 ? "⁻" : "") + [...String(Math.abs(power))].map((digit) => RAISED[digit]).join("");
}

function minus(text) {
  return text.replace("-", "−");
}
