// ---- the picture --------------------------------------------------------------------------------

const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

const view = {
  centre: [0, 0], scale: 1, parts: [],
  size() { const box = $("map").getBoundingClientRect(); return [box.width || 600, box.height || 400]; },
  fit(points) {
    const [w, h] = view.size(), xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)], margin = w < 500 ? 56 : 90;
    view.centre = [(x0 + x1) / 2, (y0 + y1) / 2];
    view.scale = Math.min((w - 2 * margin) / Math.max(x1 - x0, 1e-3), (h - 2 * margin) / Math.max(y1 - y0, 1e-3));
  },
  to([x, y]) { const [w, h] = view.size0; return [w / 2 + (x - view.centre[0]) * view.scale, h / 2 - (y - view.centre[1]) * view.scale]; },
  from(px, py) { const [w, h] = view.size(); return [view.centre[0] + (px - w / 2) / view.scale, view.centre[1] - (py - h / 2) / view.scale]; },
  metres: (pixels) => pixels / view.scale,
  box() { const [w, h] = view.size(), [a, b] = view.from(0, h), [c, d] = view.from(w, 0); return [a, c, b, d]; },
  begin() { view.size0 = view.size(); view.parts = []; },
  line(points, style, closed = false) {
    const limit = 1e5, at = points.map((p) => view.to(p).map((v) => Math.max(-limit, Math.min(limit, v)).toFixed(1)).join(" "));
    if (at.length) view.parts.push(`<path class="${style}" d="M${at.join("L")}${closed ? "Z" : ""}"/>`);
  },
  dot(p, style, radius) { const [x, y] = view.to(p); view.parts.push(`<circle class="${style}" cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="${radius}"/>`); },
  label(p, text) {
    const [x, y] = view.to(p), right = x > view.size0[0] - 100;
    view.parts.push(`<text class="label" x="${(x + (right ? -13 : 13)).toFixed(1)}" y="${(y - 11).toFixed(1)}" text-anchor="${right ? "end" : "start"}">${html(text)}</text>`);
  },
  grid() {
    const [w, h] = view.size0, [x0, x1, y0, y1] = view.box(), step = nice((x1 - x0) / (w < 500 ? 4 : 7));
    const text = (v) => (step >= 1000 ? `${brief(v / 1000, 6)} km` : `${brief(v, 6)} m`);
    for (let k = Math.ceil(x0 / step); k * step < x1; k++) { const x = view.to([k * step, 0])[0]; view.parts.push(`<line class="gridline" x1="${x}" x2="${x}" y1="0" y2="${h}"/>`, x > 40 && x < w - 30 ? `<text x="${x}" y="${h - 7}" text-anchor="middle">${text(k * step)}</text>` : ""); }
    for (let k = Math.ceil(y0 / step); k * step < y1; k++) { const y = view.to([0, k * step])[1]; view.parts.push(`<line class="gridline" x1="0" x2="${w}" y1="${y}" y2="${y}"/>`, y > 14 && y < h - 24 ? `<text x="6" y="${y - 4}">${text(k * step)}</text>` : ""); }
  },
};

function nice(x) { const p = 10 ** Math.floor(Math.log10(x)), f = x / p; return p * (f < 1.5 ? 1 : f < 3.5 ? 2 : f < 7.5 ? 5 : 10); }

function drawChart({ title, note, x, lines, log, unit, kind, zero }, play) {
  $("chart-title").textContent = title; $("chart-note").textContent = note;
  const svg = $("chart"), w = svg.getBoundingClientRect().width || 600, h = 190, left = 58, right = 12, top = 10, bottom = 26;
  svg.setAttribute("viewBox", `0 0 ${w} ${h}`); svg.setAttribute("aria-label", title);
  const all = lines.flatMap((l) => l.y).filter((v) => isFinite(v) && (!log || v > 0)), value = (v) => (log ? Math.log10(v) : v), parts = [];
  if (!all.length) { svg.innerHTML = `<text x="${w / 2}" y="${h / 2}" text-anchor="middle">not determined at any time</text>`; return; }
  let low = Math.min(...all.map(value)), high = Math.max(...all.map(value));
  if (log) { high = Math.min(high, low + 6); if (high - low < 0.6) { low -= 0.3; high += 0.3; } } else { if (zero) low = 0; if (high - low < 1e-12) { low -= 1; high += 1; } }
  const px = (v) => left + ((v - x[0]) / (x[x.length - 1] - x[0] || 1)) * (w - left - right), py = (v) => h - bottom - ((value(v) - low) / (high - low)) * (h - top - bottom);
  const ticks = [];
  if (log) { for (let e = Math.floor(low); e <= Math.ceil(high); e++) for (const f of high - low < 1.5 ? [1, 2, 5] : [1]) ticks.push(f * 10 ** e); } else { const s = nice((high - low) / 4); for (let k = Math.ceil(low / s); k * s <= high + 1e-12; k++) ticks.push(k * s); }
  for (const t of ticks) { const y = py(t); if (y < top - 1 || y > h - bottom + 1) continue; const text = unit === "m" && t >= 1000 ? `${brief(t / 1000)} km` : `${brief(t)} ${unit}`; parts.push(`<line class="gridline" x1="${left}" x2="${w - right}" y1="${y}" y2="${y}"/><text x="${left - 6}" y="${y + 4}" text-anchor="end">${text}</text>`); }
  const minutes = kind === "s" && x[x.length - 1] > 240, by = minutes ? 60 : 1, step = nice((x[x.length - 1] - x[0]) / by / (w < 500 ? 4 : 7)) * by;
  for (let k = Math.ceil(x[0] / step); k * step <= x[x.length - 1] + 1e-9; k++) parts.push(`<text x="${px(k * step)}" y="${h - 8}" text-anchor="middle">${brief((k * step) / by)}${minutes ? " min" : kind === "s" ? " s" : ""}</text>`);
  parts.push(`<line class="axis" x1="${left}" x2="${w - right}" y1="${h - bottom}" y2="${h - bottom}"/>`);
  for (const { y, style, dots } of lines) {
    if (dots !== undefined) { y.forEach((v, k) => { if (isFinite(v)) parts.push(`<circle class="reading ${dots}" cx="${px(x[k]).toFixed(1)}" cy="${py(v).toFixed(1)}" r="2"/>`); }); continue; }
    let d = "", pen = false;
    y.forEach((v, k) => { const ok = isFinite(v) && (!log || v > 0); if (ok) d += `${pen ? "L" : "M"}${px(x[k]).toFixed(1)} ${Math.max(top, Math.min(h, py(v))).toFixed(1)}`; pen = ok; });
    parts.push(`<path class="curve ${style || ""}" d="${d}"/>`);
  }
  if (play !== null) { const at = left + play * (w - left - right); parts.push(`<line class="cursor" x1="${at}" x2="${at}" y1="${top}" y2="${h - bottom}"/>`); }
  svg.innerHTML = parts.join("");
}

