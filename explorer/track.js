// ---- a target and one observer --------------------------------------------------------

// A path of more waypoints than this is a recording: its points are no handles.
const MANY = 24;
const SENSORS = [["bearing", "deg"], ["range", "m"], ["frequency", "Hz"]];

const track = {
  start: () => ({
    path: [[0, 0], [1500, 600], [1500, 2600]], target: [3000, 4200, -3, 1.2], step: 15, count: 60,
    sigma: { bearing: 0.5, range: 25, frequency: 0.02 }, use: { bearing: true, range: false, frequency: false },
    tonal: 150, wave: 1500, prior: { position: 1000, speed: 2 }, know: { position: false, speed: false },
    at: null, times: null, measured: null,  // a scene of the user's own: times of the waypoints, of the measurements, and what these read
  }),
  optional: { at: [0], times: [0], measured: { times: [0], path: [[0]], values: [0], status: "", reason: "" } },
  presets: {
    "A turn": {},
    "Straight: unobservable": { path: [[0, 0], [1500, 2000]] },
    "A slight turn: weak": { path: [[0, 0], [750, 1000], [1530, 1980]], sigma: { bearing: 2, range: 25, frequency: 0.02 } },
    "Straight, speed known": { path: [[0, 0], [1500, 2000]], know: { position: false, speed: true } },
    "Straight, with ranges": { path: [[0, 0], [1500, 2000]], use: { bearing: true, range: true, frequency: false } },
    "Fixed observer": { path: [[0, 0]] },
    ...JSON.parse(document.getElementById("demo").textContent),
  },
  times: (s) => (s.measured ? s.measured.times : s.times || Array.from({ length: s.count }, (_, k) => k * s.step)),
  span: (s) => { const times = track.times(s); return times[times.length - 1] - times[0]; },
  // Waypoints have times, or are passed at constant speed over the time of the measurements.
  way(s) {
    const times = track.times(s), first = times[0], last = times[times.length - 1];
    const own = s.measured ? { times, path: s.measured.path } : s.at && s.at.length === s.path.length && s.path.length > 1 ? { times: s.at, path: s.path } : null;
    if (own) {
      const length = own.path.reduce((sum, p, k) => (k ? sum + Math.hypot(p[0] - own.path[k - 1][0], p[1] - own.path[k - 1][1]) : 0), 0);
      return { ...own, speed: length / (own.times[own.times.length - 1] - own.times[0]) };
    }
    const path = s.path.filter((p, k) => k === 0 || Math.hypot(p[0] - s.path[k - 1][0], p[1] - s.path[k - 1][1]) > 1e-3);
    if (path.length === 1) path.push(path[0]);
    const along = [0];
    for (let k = 1; k < path.length; k++) along.push(along[k - 1] + Math.hypot(path[k][0] - path[k - 1][0], path[k][1] - path[k - 1][1]));
    const length = along[along.length - 1];
    const at = along.map((d, k) => (k === path.length - 1 ? last : Math.round((length ? d / length : k) * (last - first) * 100) / 100 + first));
    for (let k = path.length - 2; k > 0; k--) at[k] = Math.min(at[k], at[k + 1] - 0.01);
    return { times: at, path, speed: length / (last - first) };
  },
  names: (s) => ["x0", "y0", "vx", "vy", ...(s.use.frequency ? ["tonal"] : [])],
  units: (s) => ["m", "m", "m/s", "m/s", ...(s.use.frequency ? ["Hz"] : [])],
  prior: (s) => [0, 0, 1, 1].map((k) => { const what = k ? "speed" : "position"; return s.know[what] && !s.measured ? s.prior[what] : Infinity; }).concat(s.use.frequency ? [Infinity] : []),
  question(s) {
    const way = track.way(s);
    const sigma = SENSORS.map(([kind]) => (s.use[kind] ? s.sigma[kind] * (kind === "bearing" ? DEGREE : 1) : 0));
    return [way.times, way.path.flat(), track.times(s), [...sigma, s.wave], track.state(s), track.prior(s)];
  },
  analyze(s) {
    const names = track.names(s), units = track.units(s);
    const [said, status, singular, flat, bound, data, scale, covariance, weakest, along, values] = ask("track", [...track.question(s), bytes(names), bytes(units)]);
    const verdict = verdictOf(said), nullSpace = vectors(flat, names.length);
    // Of a file the estimate is judged, which outranks what its geometry alone would allow.
    if (s.measured) Object.assign(verdict, { status: s.measured.status, reason: s.measured.reason, tone: TONES[s.measured.status] || "bad" });
    return { verdict, status, singular, nullSpace, bound, data, scale, covariance, weakest, along: vectors(along, 2), values, names, units, state: track.state(s) };
  },
  state: (s) => s.target.concat(s.use.frequency ? [s.tonal] : []),
  // What a drag shows at once: the next heading; other tracks that fit, or the regions roughly.
  soon(s, a) {
    const question = track.question(s), span = track.span(s), way = track.way(s), [data, others] = track.data(s), out = {};
    if (way.speed > 0) out.headings = ["track_headings", [...question, [way.speed, span / 3, 20, 36]]];
    if (a.nullSpace.length) out.fits = ["track_fits", [...question, data, track.alike(s, a).flat()]];
    else [0, span].forEach((after, k) => (out[`region${k}`] = ["track_region", [...question, [after, 0.95, 1], data, others]]));
    return out;
  },
  // What comes a little later: the regions as the library has them, and the intervals.
  later(s, a) {
    if (a.nullSpace.length) return {};
    const question = track.question(s), span = track.span(s), [data, others] = track.data(s), out = {};
    [0, span].forEach((after, k) => (out[`region${k}`] = ["track_region", [...question, [after, 0.95, 0], data, others]]));
    out.intervals = ["track_intervals", [...question, [0.95], data, others]];
    return out;
  },
  data: (s) => [s.measured ? s.measured.values : [], (s.measured && s.measured.other) || []],
  // States along the null directions, as far as the target is away.
  alike(s, a) {
    const span = track.span(s), place = track.way(s).path[0], range = Math.hypot(s.target[0] - place[0], s.target[1] - place[1]), out = [];
    for (const direction of a.nullSpace.slice(0, 2)) {
      const size = Math.max(Math.hypot(direction[0], direction[1]), Math.hypot(direction[2], direction[3]) * span);
      if (size > 0) for (const k of [-0.6, -0.4, -0.2, 0.2, 0.4, 0.6, 0.8, 1]) out.push(a.state.map((x, i) => x + (k * range * direction[i]) / size));
    }
    return out;
  },
  // Of the answers that are there already, by their names.
  gather(s, a, found) {
    const out = {};
    if (found.fits) out.tracks = track.alike(s, a).map((state, k) => ({ state, chi2: found.fits[0][k] }));
    if (found.region0 && found.region1) {
      out.regions = [found.region0, found.region1].flatMap((lists) => lists.filter((_, k) => k % 2 === 0).map((points, k) => ({ points: vectors(points, 2), closed: lists[2 * k + 1][0] === 1, complete: lists[2 * k + 1][1] === 1 })));
    }
    if (found.headings) out.headings = vectors(found.headings[0] || [], 2).map(([e, n]) => Math.hypot(e, n));
    if (found.intervals) out.intervals = found.intervals;
    return out;
  },
  handles(s) {
    if (s.measured) return [];
    const span = track.span(s), list = s.path.length > MANY ? [] : s.path.map((p, k) => ({
      name: `observer waypoint ${k + 1}`, kind: "observer", at: p, move: (x, y) => (s.path[k] = [x, y]),
      // The times of the others stay, if the path goes on from the first to the last.
      remove: s.path.length > 1 ? () => { s.path.splice(k, 1); if (s.at && k > 0 && k < s.path.length) s.at.splice(k, 1); else s.at = null; } : null,
    }));
    list.push({ name: "target at the first measurement", kind: "target", at: s.target.slice(0, 2), move: (x, y) => { s.target[0] = x; s.target[1] = y; } });
    list.push({ name: "target at the last measurement: its velocity", kind: "target", small: true, at: [s.target[0] + span * s.target[2], s.target[1] + span * s.target[3]], move: (x, y) => { s.target[2] = (x - s.target[0]) / span; s.target[3] = (y - s.target[1]) / span; } });
    return list;
  },
  extent(s) {
    const span = track.span(s);
    return [...track.way(s).path, s.target.slice(0, 2), [s.target[0] + span * s.target[2], s.target[1] + span * s.target[3]]];
  },
  draw(view, s, a, more, play) {
    const times = track.times(s), first = times[0], span = times[times.length - 1] - first, way = track.way(s);
    const place = (state, u) => [state[0] + u * state[2], state[1] + u * state[3]];
    const carrier = (t) => {
      let k = way.times.findIndex((x) => x >= t);
      if (k <= 0) return way.path[k < 0 ? way.path.length - 1 : 0];
      const w = (t - way.times[k - 1]) / (way.times[k] - way.times[k - 1]);
      return [0, 1].map((i) => way.path[k - 1][i] + w * (way.path[k][i] - way.path[k - 1][i]));
    };
    const old = more.stale ? " stale" : "";
    if (a.nullSpace.length) for (const { state } of more.tracks || []) view.line([place(state, 0), place(state, span)], "same" + old);
    else for (const region of more.regions || []) view.line(region.points, "region" + old, region.closed);
    if (a.covariance.length) for (const u of [0, span]) view.line(ellipse(a, u), "ellipse", true);
    const each = Math.max(1, Math.round(times.length / 10));
    times.forEach((t, k) => { if (k % each === 0 || k === times.length - 1) view.line([carrier(t), place(s.target, t - first)], "sight"); });
    if (more.headings && more.headings.some(isFinite)) rose(view, way.path[way.path.length - 1], more.headings);
    view.line(way.path, "path");
    view.line([place(s.target, 0), place(s.target, span)], "track");
    times.forEach((t) => view.dot(carrier(t), "observer", 1.8));
    view.label(way.path[0], "observer"); view.label(s.target, "target");
    if (play !== null) {
      const t = first + play * span;
      view.line([carrier(t), place(s.target, t - first)], "cursor");
      view.dot(carrier(t), "observer mark", 7); view.dot(place(s.target, t - first), "target mark", 7);
    }
  },
  legend: (s, a) => ["<span><i style='border-color:var(--observer)'></i>observer</span><span><i style='border-color:var(--target)'></i>target</span>",
    a.nullSpace.length ? "<span><i style='border-color:var(--null);border-top-style:dashed'></i>other tracks along the null direction</span>"
      : "<span><i style='border-color:var(--region)'></i>95 % likelihood region, first and last place</span><span><i style='border-color:var(--soft);border-top-style:dashed'></i>local ellipse</span>",
    "<span><i style='border-color:var(--good)'></i>next leg: longer is better</span>"].join(""),
  facts(s, a, more) {
    const out = [], way = track.way(s);
    for (const text of a.verdict.combinations) out.push(`not observable: <b>${html(text)}</b>`);
    if (a.nullSpace.length && more.tracks && more.tracks.length) {
      const worst = Math.max(...more.tracks.map((t) => t.chi2).filter(isFinite));
      out.push(worst < 1e-6 ? "the dashed tracks give exactly the same measurements" : `equal to first order: along the dashed tracks chi2 rises by up to ${brief(worst)}`);
    }
    if (more.headings && more.headings.some(isFinite)) {
      const best = more.headings.indexOf(Math.min(...more.headings));
      out.push(`best next heading <b>${best * 10}°</b>: 1 sigma of the last place ${metres(more.headings[best])} after one more leg`);
    }
    const times = track.times(s);
    if (s.measured) out.push(`${times.length} measured bearings: ${html(s.measured.status)}`);
    else out.push(`observer ${brief(way.speed)} m/s, target ${brief(Math.hypot(s.target[2], s.target[3]))} m/s, ${times.length} times in ${brief(track.span(s) / 60)} min`);
    return out;
  },
  chart(s, a) {
    const times = track.times(s);
    return { title: "Bound of the target's place against time", note: "1 sigma of the place at each time, from the measurements up to then (m, logarithmic). No line: not determined yet.", log: true, unit: "m", x: times.map((t) => t - times[0]), lines: [{ y: a.along.map(([e, n]) => Math.hypot(e, n)) }], kind: "s" };
  },
  controls: (s) => [
    { kind: "choice", label: "Example", options: ["", ...Object.keys(track.presets)], set: (v) => v && replace(Object.assign(track.start(), structuredClone(track.presets[v]))) },
    ...SENSORS.map(([kind, unit]) => ({ kind: "range", label: kind[0].toUpperCase() + kind.slice(1), key: kind, of: s.sigma, check: s.use, unit, low: { bearing: 0.05, range: 1, frequency: 0.002 }[kind], high: { bearing: 5, range: 500, frequency: 1 }[kind], log: true })),
    { kind: "range", label: "Prior of the place", key: "position", of: s.prior, check: s.know, unit: "m", low: 50, high: 10000, log: true, off: !!s.measured },
    { kind: "range", label: "Prior of the velocity", key: "speed", of: s.prior, check: s.know, unit: "m/s", low: 0.1, high: 20, log: true, off: !!s.measured },
    { kind: "range", label: "Measurements", key: "count", of: s, unit: "", low: 4, high: 200, whole: true, off: !!(s.measured || s.times) },
    { kind: "range", label: "One every", key: "step", of: s, unit: "s", low: 1, high: 60, whole: true, off: !!(s.measured || s.times) },
  ],
  buttons: (s) => [
    { label: "Add waypoint", run: () => { const a = s.path[s.path.length - 1], b = s.path[s.path.length - 2] || [a[0] - 800, a[1]]; s.path.push([a[0] - (b[1] - a[1]) * 0.6, a[1] + (b[0] - a[0]) * 0.6]); s.at = null; }, off: !!s.measured || s.path.length > 11 },
    { label: "Remove waypoint", run: () => { s.path.pop(); s.at = null; }, off: !!s.measured || s.path.length < 2 || s.path.length > MANY },
    { play: true },
    { upload: true, label: "Load CSV", hint: "columns time (s), x and y (m) of the observer, bearing_deg", load: (text) => track.load(s, text) },
    ...(s.measured ? [{ label: "Drop the bearings", run: () => { const { path, times } = s.measured; Object.assign(s, { path, at: [...times], times: [...times], measured: null }); thin(s); } }] : []),
    ...(!s.measured && s.path.length > MANY ? [{ label: "Waypoints to drag", run: () => thin(s) }] : []),
  ],
  // time (s), x, y (m) of the observer, bearing (deg clockwise from north, or rad where the heading says so).
  load(s, text) {
    const read = table(text, {
      time: TIME, x: { label: "x", pattern: /^x|east|_x$/ }, y: { label: "y", pattern: /^y|north|_y$/ }, bearing: { label: "bearing_deg", pattern: /bear|brg|azim/ },
    }, { least: 4 });
    const radians = /rad/.test(read.headings.bearing), most = radians ? 2 * Math.PI : 360;
    read.bearing.forEach((value, i) => { if (Math.abs(value) > most * (1 + 1e-9)) throw new Error(`${read.headings.bearing}, line ${read.line(i)} = ${value}: must be between ${radians ? "-2 pi and 2 pi" : "-360 and 360 degrees"}`); });
    track.measure(s, { times: read.time, path: read.x.map((v, i) => [v, read.y[i]]), values: read.bearing.map((v) => (radians ? v : v * DEGREE)) });
  },
  measure(s, { times, path, values }) {
    const next = { ...s, use: { bearing: true, range: false, frequency: false }, know: { position: false, speed: false }, measured: { times, path, values, status: "", reason: "", other: [] } };
    track.fit(next);
    Object.assign(s, next);
  },
  // Without priors: where their means would be, a file does not say.
  fit(s) {
    const [said, state, other] = ask("track_estimate", [...track.question(s), s.measured.values, bytes(track.names(s))]);
    const [status, reason] = lines(said);
    s.target = state;
    Object.assign(s.measured, { status, reason, other });
  },
  python(s) {
    const way = track.way(s), own = s.measured || s.times, t = own ? `np.array(${list(track.times(s))})` : `${s.step} * np.arange(${s.count})`;
    const sensors = SENSORS.filter(([k]) => s.use[k]).map(([k]) => `    gm.tracks.Sensor.${k}(observer, times, sigma=${k === "bearing" ? `np.radians(${s.sigma[k]})` : s.sigma[k]}${k === "frequency" ? `, speed=${s.wave}` : ""}),`);
    const prior = track.prior(s), names = track.names(s), known = names.filter((_, i) => isFinite(prior[i])).map((name) => `"${name}": ${prior[names.indexOf(name)]}`);
    const state = track.state(s);
    const lines = ["import gramian as gm", "import numpy as np", "", `times = ${t}`,
      `observer = gm.tracks.Carrier(${pairs(way.path)}, ${list(way.times)})`, "sensors = [", ...sensors, "]",
      "scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)",
      `state = {${names.map((name, i) => `"${name}": ${state[i]}`).join(", ")}}`,
      `problem = gm.tracks.problem(scene, state)${known.length ? `.prior({${known.join(", ")}})` : ""}`, "answer = gm.analyze(problem)", "print(answer.summary())"];
    if (s.measured) lines.push("", `bearings = np.array(${list(s.measured.values)})`, "print(gm.tracks.estimate(scene, [bearings]).summary())");
    return lines.join("\n") + "\n";
  },
  toml(s) {
    const way = track.way(s), state = track.state(s), names = track.names(s), prior = track.prior(s);
    const t = s.measured || s.times ? list(track.times(s)) : `{ first = 0.0, last = ${real((s.count - 1) * s.step)}, step = ${real(s.step)} }`;
    const lines = ["# gramian analyze scene.toml", ...(s.measured ? ["# The geometry of the estimate: the measured bearings are not in this file."] : []), 'model = "tracks"', "", "[[carriers]]", 'name = "observer"', `path = ${pairs(way.path)}`, `times = ${list(way.times)}`];
    for (const [kind] of SENSORS) if (s.use[kind]) lines.push("", "[[sensors]]", `kind = "${kind}"`, 'carrier = "observer"', `times = ${t}`, `sigma${kind === "bearing" ? "_deg" : ""} = ${real(s.sigma[kind])}`, ...(kind === "frequency" ? ['tonal = "tonal"', `speed = ${real(s.wave)}`] : []));
    lines.push("", "[target]", ...names.map((name, i) => `${name} = ${real(state[i])}`));
    const known = names.map((name, i) => (isFinite(prior[i]) ? `${name} = ${real(prior[i])}` : "")).filter(Boolean);
    if (known.length) lines.push("", "[prior]", ...known);
    return lines.join("\n") + "\n";
  },
};

const real = (x) => (Number.isInteger(x) && Math.abs(x) < 1e15 ? x + ".0" : String(x));
const list = (values) => `[${values.map(real).join(", ")}]`;
const pairs = (points) => `[${points.map(list).join(", ")}]`;
const metres = (value) => (!isFinite(value) ? "not determined" : value < 1e3 ? `${brief(value)} m` : `${brief(value / 1e3)} km`);
// A path of eight pieces at most, each with its time.
function thin(s) {
  const step = Math.max(1, Math.ceil(s.path.length / 8)), kept = s.path.map((_, k) => k).filter((k) => k % step === 0 || k === s.path.length - 1);
  s.path = kept.map((k) => s.path[k]);
  s.at = s.at && kept.map((k) => s.at[k]);
}

// The local 95 % ellipse of the place after u seconds: a picture of the covariance.
function ellipse(a, u) {
  const n = a.names.length, c = (i, j) => a.covariance[i * n + j];
  const at = (i, j) => c(i, j) + u * (c(i, j + 2) + c(i + 2, j)) + u * u * c(i + 2, j + 2);
  const l = Math.sqrt(at(0, 0)), m = at(0, 1) / l, q = Math.sqrt(Math.max(0, at(1, 1) - m * m)), r = Math.sqrt(5.991464547107979);
  const x = a.state[0] + u * a.state[2], y = a.state[1] + u * a.state[3];
  return Array.from({ length: 73 }, (_, k) => { const v = (k * Math.PI) / 36, [p, s] = [r * Math.cos(v), r * Math.sin(v)]; return [x + l * p, y + m * p + q * s]; });
}

// The accuracy after one more leg, by its heading: long where it is good.
function rose(view, centre, values) {
  const least = Math.min(...values), reach = view.metres(46), best = values.indexOf(least);
  const point = (k, r) => { const v = (k * 10) * DEGREE; return [centre[0] + r * Math.sin(v), centre[1] + r * Math.cos(v)]; };
  view.line(values.map((value, k) => point(k, isFinite(value) ? reach * (least / value) : 0)), "rose", true);
  view.line([centre, point(best, reach * 1.25)], "best");
}

