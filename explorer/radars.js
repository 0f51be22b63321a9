// ---- two radars ------------------------------------------------------------------------------

const radars = {
  start: () => ({ a: [0, 0], b: [60000, 0], from: [-10000, 25000], to: [60000, 45000], count: 100, range: 50, azimuth: 0.1, range2: 50, azimuth2: 0.1, circle: 2000, track: null }),
  optional: { track: [[0]] },
  names: () => ["A.range", "A.azimuth", "B.range", "B.azimuth"],
  units: () => ["m", "rad", "m", "rad"],
  sigma: (s) => [s.range, s.azimuth * DEGREE, s.range2, s.azimuth2 * DEGREE],
  positions: (s) => s.track || Array.from({ length: s.count }, (_, k) => [0, 1].map((i) => s.from[i] + k * ((s.to[i] - s.from[i]) / (s.count - 1)))),
  analyze(s) {
    const names = radars.names(), units = radars.units();
    const [said, status, singular, flat, bound, degrees] = ask("radars", [[...s.a, ...s.b], radars.sigma(s), radars.positions(s).flat(), bytes(names), bytes(units)]);
    return { verdict: verdictOf(said), status, singular, nullSpace: vectors(flat, 4), bound, degrees, names, units };
  },
  grid() { const box = view.box(), nx = 60; return { box, nx, ny: Math.min(120, Math.max(8, Math.round((nx * (box[3] - box[2])) / (box[1] - box[0])))) }; },
  soon: () => ({}),
  later(s) {
    const { box, nx, ny } = radars.grid(), line = (low, high, n) => Array.from({ length: n }, (_, k) => low + ((k + 0.5) * (high - low)) / n);
    return { map: ["radars_map", [[...s.a, ...s.b], radars.sigma(s), line(box[0], box[1], nx), line(box[2], box[3], ny), [s.circle]]] };
  },
  gather(s, a, found) {
    if (!found.map) return {};
    const nx = 60, map = found.map[0];
    return { nx, ny: map.length / nx, map };
  },
  handles: (s) => [["a", "radar A", "observer"], ["b", "radar B", "observer"], ["from", "first place of the target", "target"], ["to", "last place of the target", "target"]].filter(([key]) => !s.track || key.length === 1).map(([key, name, kind]) => ({ name, kind, at: s[key], small: key === "to", move: (x, y) => (s[key] = [x, y]) })),
  extent: (s) => [s.a, s.b, ...(s.track || [s.from, s.to])],
  draw(view, s, a, more, play) {
    if (more.map) heat(more);
    view.line([s.a, s.b], "ellipse");
    const looks = radars.positions(s);
    view.line(looks, "track");
    looks.forEach((p) => view.dot(p, "target", 1.8));
    view.label(s.a, "radar A"); view.label(s.b, "radar B"); view.label(looks[0], "target");
    if (play !== null) view.dot(looks[Math.round(play * (looks.length - 1))], "target mark", 7);
  },
  legend(s, a, more) {
    const [low, high] = more.map ? shades(more.map) : [NaN, NaN];
    return `<span>Colour: degree eta of looks on a circle around each place, from ${brief(10 ** low, 2)} (dark) to ${brief(10 ** high, 2)} (bright), logarithmic</span>`;
  },
  facts(s, a) {
    const out = a.verdict.combinations.map((text) => `not observable: <b>${html(text)}</b>`);
    out.push(`degree eta of the track <b>${brief(a.degrees[a.degrees.length - 1])}</b> of at most 1`);
    out.push(`rank ${a.status[0]} of 4 from ${radars.positions(s).length} looks`);
    return out;
  },
  chart: (s, a) => ({ title: "Degree of observability along the track", note: "eta of all looks so far, between 0 and 1.", unit: "", x: a.degrees.map((_, k) => k + 1), lines: [{ y: a.degrees }], kind: "looks", zero: true }),
  controls: (s) => [
    { kind: "choice", label: "Example", options: ["", "Across", "Along the baseline: unobservable", "Far away"], set: (v) => v && replace(Object.assign(radars.start(), { Across: {}, "Along the baseline: unobservable": { from: [6000, 0], to: [54000, 0] }, "Far away": { from: [90000, 100000], to: [100000, 140000] } }[v])) },
    ...["A", "B"].flatMap((name, k) => [
      { kind: "range", label: `Radar ${name}: range`, key: k ? "range2" : "range", of: s, unit: "m", low: 1, high: 500, log: true },
      { kind: "range", label: `Radar ${name}: azimuth`, key: k ? "azimuth2" : "azimuth", of: s, unit: "deg", low: 0.01, high: 2, log: true },
    ]),
    { kind: "range", label: "Looks", key: "count", of: s, unit: "", low: 2, high: 300, whole: true, off: !!s.track },
    { kind: "range", label: "Circle of the map", key: "circle", of: s, unit: "m", low: 200, high: 20000, log: true },
  ],
  buttons: (s) => [
    { play: true },
    { upload: true, label: "Load CSV", hint: "columns x and y (m) of the target, and time (s) if you like", load: (text) => radars.load(s, text) },
    ...(s.track ? [{ label: "Drop the track", run: () => { s.from = s.track[0]; s.to = s.track[s.track.length - 1]; s.count = Math.min(300, s.track.length); s.track = null; } }] : []),
  ],
  // A track of the user's own: places of the target, one a look.
  load(s, text) {
    const timed = /^(\uFEFF)?[^\n]*\b(t|t_s|time\w*|seconds?|sec)\b/i.test(text.trim().split("\n")[0] || "");
    const read = table(text, { ...(timed ? { time: TIME } : {}), x: { label: "x", pattern: /^x|^east/ }, y: { label: "y", pattern: /^y|^north/ } });
    s.track = read.x.map((x, i) => [x, read.y[i]]);
  },
  python: (s) => ["import gramian as gm", "import numpy as np", "", s.track ? `positions = np.array(${pairs(s.track)})` : `positions = np.array(${list(s.from)}) + np.arange(${s.count})[:, None] * np.array(${list(radars.step(s))})`,
    `sensors = {"A": ${list(s.a)}, "B": ${list(s.b)}}`, `sigma = [[${s.range}, np.radians(${s.azimuth})], [${s.range2}, np.radians(${s.azimuth2})]]`, "print(gm.analyze(gm.registration.problem(positions, sensors, sigma)).summary())", 'print("eta", gm.registration.eta(positions, sensors, sigma))'].join("\n") + "\n",
  step: (s) => [0, 1].map((i) => (s.to[i] - s.from[i]) / (s.count - 1)),
  toml(s) {
    // A scenario has straight tracks: a recorded one is a track for each look, two for the last.
    const parts = s.track ? s.track.slice(0, -1).map((p, k) => [p, [0, 1].map((i) => s.track[k + 1][i] - p[i]), k === s.track.length - 2 ? 1 : 0]) : [[s.from, radars.step(s), s.count - 1]];
    return ["# gramian analyze scene.toml", 'model = "registration"', "", ...["a", "b"].flatMap((key, k) => [`[sensors.${key.toUpperCase()}]`, `east = ${real(s[key][0])}`, `north = ${real(s[key][1])}`, `sigma_range = ${real(k ? s.range2 : s.range)}`, `sigma_azimuth_deg = ${real(k ? s.azimuth2 : s.azimuth)}`, ""]),
      ...parts.flatMap(([start, velocity, duration], k) => [`[tracks.target${s.track ? k : ""}]`, `start = ${list(start)}`, `velocity = ${list(velocity)}`, `duration = ${real(duration || 0.5)}`, "step = 1.0", ""])].join("\n").trimEnd() + "\n";
  },
};

// The decades that the map shows.
function shades(map) {
  const all = map.filter((v) => v > 0).map(Math.log10).sort((a, b) => a - b);
  const high = all[all.length - 1] ?? 0;
  return [Math.min(Math.max(all[Math.floor(all.length * 0.02)] ?? -1, high - 6), high - 0.3), high];
}

function heat({ nx, ny, map }) {
  const [low, high] = shades(map);
  const canvas = document.getElementById("heat"), context = canvas.getContext("2d");
  canvas.width = nx; canvas.height = ny;
  const image = context.createImageData(nx, ny), stops = [[30, 33, 72], [46, 92, 140], [40, 150, 140], [150, 200, 95], [250, 228, 90]];
  map.forEach((value, k) => {
    const x = k % nx, y = ny - 1 - Math.floor(k / nx), w = Math.max(0, Math.min(1, (Math.log10(value || 1e-9) - low) / (high - low))) * (stops.length - 1);
    const i = Math.min(stops.length - 2, Math.floor(w)), at = 4 * (y * nx + x);
    for (let c = 0; c < 3; c++) image.data[at + c] = stops[i][c] + (w - i) * (stops[i + 1][c] - stops[i][c]);
    image.data[at + 3] = 255;
  });
  context.putImageData(image, 0, 0);
}

