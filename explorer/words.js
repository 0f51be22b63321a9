// ---- words ---------------------------------------------------------------------------

const DEGREE = Math.PI / 180;

function brief(value, digits = 3) {
  if (!isFinite(value)) return value > 0 ? "inf" : value < 0 ? "-inf" : "nan";
  const rounded = Number(value.toPrecision(digits)), size = Math.abs(rounded);
  return size !== 0 && size < 1e-4 ? rounded.toExponential() : String(rounded);
}

const html = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

// The verdict as the library words it: status, reason, and what is not determined.
const TONES = { observable: "good", determined: "good", weak: "weak", ambiguous: "weak" };
function verdictOf(list) {
  const [status, reason, ...combinations] = lines(list);
  return { status, reason, combinations, tone: TONES[status] || "bad" };
}

function vectors(flat, n) {
  const out = [];
  for (let i = 0; i < flat.length; i += n) out.push(flat.slice(i, i + n));
  return out;
}

