"use strict";
// The page of the explorer. The numbers come from rust/gramian-explorer; here are the
// scene, the picture and the words.

// ---- the library -------------------------------------------------------------------

let wasm;

function ask(name, lists) {
  const count = lists.reduce((sum, list) => sum + 1 + list.length, 0);
  const at = wasm.explorer_input(count) / 8;
  const memory = new Float64Array(wasm.memory.buffer);
  let k = at;
  for (const list of lists) {
    memory[k++] = list.length;
    for (const value of list) memory[k++] = value;
  }
  if (!wasm["explorer_" + name]()) {
    const text = new Uint8Array(wasm.memory.buffer, wasm.explorer_error(), wasm.explorer_error_count());
    throw new Error(new TextDecoder().decode(text));
  }
  const found = new Float64Array(wasm.memory.buffer, wasm.explorer_output(), wasm.explorer_output_count());
  const out = [];
  for (let i = 0; i < found.length; i += 1 + found[i]) out.push(Array.from(found.subarray(i + 1, i + 1 + found[i])));
  return out;
}

// ---- words ---------------------------------------------------------------------------

const DEGREE = Math.PI / 180;

function brief(value, digits = 3) {
  if (!isFinite(value)) return value > 0 ? "inf" : value < 0 ? "-inf" : "nan";
  const rounded = Number(value.toPrecision(digits)), size = Math.abs(rounded);
  return size !== 0 && size < 1e-4 ? rounded.toExponential() : String(rounded);
}

const moves = (change, names) =>
  change.map((v, i) => (v === 0 ? "" : `${names[i]} ${v < 0 ? "-" : "+"}${brief(Math.abs(v), 4)}`)).filter(Boolean).join(", ");

const html = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

// The rules of `gm.analyze`: unobservable before weak before observable.
function judge({ status, nullSpace, data, scale, prior, singular, names, units }) {
  const [rank, n] = status, nullity = n - rank;
  if (nullity) {
    const what = nullity === 1 ? "1 combination is" : `${nullity} combinations are`;
    return { status: "unobservable", tone: "bad", reason: `rank ${rank} of ${n}: ${what} not determined`, combinations: nullSpace.map((v) => moves(v, names)) };
  }
  let worst = null, limited = false;
  names.forEach((name, i) => {
    let limit = scale[i], kind = "scale";
    if (prior[i] <= (isNaN(limit) ? Infinity : limit) && isFinite(prior[i])) [limit, kind] = [prior[i], "prior"];
    if (!(limit > 0)) return;
    limited = true;
    if (data[i] / limit > 1 && !(worst && worst.ratio >= data[i] / limit)) worst = { name, unit: units[i], limit, kind, std: data[i], ratio: data[i] / limit };
  });
  if (worst) {
    const source = worst.kind === "prior" ? "from the measurements alone " : "";
    return { status: "weak", tone: "weak", combinations: [], reason: `the bound of ${worst.name} ${source}is ${brief(worst.std, 4)} ${worst.unit}, its ${worst.kind} ${brief(worst.limit, 4)} ${worst.unit}` };
  }
  const known = singular.filter(isFinite), condition = known.length ? known[0] / known[known.length - 1] : 1;
  if (!limited && condition > 1e8) return { status: "weak", tone: "weak", combinations: [], reason: `condition number ${brief(condition)} on unit columns, above 1e8` };
  return { status: "observable", tone: "good", combinations: [], reason: `rank ${n} of ${n}` };
}

function vectors(flat, n) {
  const out = [];
  for (let i = 0; i < flat.length; i += n) out.push(flat.slice(i, i + n));
  return out;
}

// ---- a target and one observer --------------------------------------------------------

const SENSORS = [["bearing", "deg"], ["range", "m"], ["frequency", "Hz"]];

const track = {
  start: () => ({
    path: [[0, 0], [1500, 600], [1500, 2600]], target: [3000, 4200, -3, 1.2], step: 15, count: 60,
    sigma: { bearing: 0.5, range: 25, frequency: 0.02 }, use: { bearing: true, range: false, frequency: false },
    tonal: 150, wave: 1500, prior: { position: 1000, speed: 2 }, know: { position: false, speed: false }, measured: null,
  }),
  presets: {
    "A turn": {},
    "Straight: unobservable": { path: [[0, 0], [1500, 2000]] },
    "A slight turn: weak": { path: [[0, 0], [750, 1000], [1530, 1980]], sigma: { bearing: 2, range: 25, frequency: 0.02 } },
    "Straight, speed known": { path: [[0, 0], [1500, 2000]], know: { position: false, speed: true } },
    "Straight, with ranges": { path: [[0, 0], [1500, 2000]], use: { bearing: true, range: true, frequency: false } },
    "Fixed observer": { path: [[0, 0]] },
  },
  times: (s) => (s.measured ? s.measured.times : Array.from({ length: s.count }, (_, k) => k * s.step)),
  // Waypoints are passed at constant speed over the time of the measurements.
  way(s) {
    const times = track.times(s), first = times[0], last = times[times.length - 1];
    if (s.measured) return { times, path: s.measured.path };
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
    return [way.times, way.path.flat(), track.times(s), [...sigma, s.wave], s.target.concat(s.use.frequency ? [s.tonal] : []), track.prior(s)];
  },
  analyze(s) {
    const [status, singular, flat, bound, data, scale, covariance, weakest, along, values] = ask("track", track.question(s));
    const names = track.names(s), units = track.units(s), n = names.length, nullSpace = vectors(flat, n);
    const verdict = judge({ status, singular, nullSpace, data, scale, prior: track.prior(s), names, units });
    // Of a file the estimate is judged, which outranks what its geometry alone would allow.
    if (s.measured) Object.assign(verdict, { status: s.measured.status, reason: s.measured.reason, tone: { determined: "good", weak: "weak", ambiguous: "weak" }[s.measured.status] || "bad" });
    return { verdict, status, singular, nullSpace, bound, data, scale, covariance, weakest, along: vectors(along, 2), values, names, units, state: s.target.concat(s.use.frequency ? [s.tonal] : []) };
  },
  // What may come a frame later: the region, the next heading, other tracks that fit.
  more(s, a) {
    const question = track.question(s), times = track.times(s), span = times[times.length - 1] - times[0];
    const data = s.measured ? s.measured.values : [];
    const out = { regions: [], tracks: [], headings: [] };
    if (!a.nullSpace.length) {
      for (const after of [0, span]) {
        const found = ask("track_region", [...question, [after, 0.95], data]);
        for (let k = 0; k < found.length; k += 2) out.regions.push({ points: vectors(found[k], 2), closed: found[k + 1][0] === 1, complete: found[k + 1][1] === 1 });
      }
    } else {
      const range = Math.hypot(s.target[0] - track.way(s).path[0][0], s.target[1] - track.way(s).path[0][1]);
      for (const direction of a.nullSpace.slice(0, 2)) {
        const size = Math.max(Math.hypot(direction[0], direction[1]), Math.hypot(direction[2], direction[3]) * span);
        if (!(size > 0)) continue;
        const states = [-0.6, -0.4, -0.2, 0.2, 0.4, 0.6, 0.8, 1].map((k) => a.state.map((x, i) => x + (k * range * direction[i]) / size));
        const fits = ask("track_fits", [...question, data, states.flat()])[0];
        states.forEach((state, k) => out.tracks.push({ state, chi2: fits[k] }));
      }
    }
    const way = track.way(s);
    if (way.speed > 0) {
      const found = ask("track_headings", [...question, [way.speed, span / 3, 20, 36]])[0];
      out.headings = vectors(found, 2).map(([e, n]) => Math.hypot(e, n));
    }
    return out;
  },
  handles(s) {
    if (s.measured) return [];
    const span = (s.count - 1) * s.step;
    const list = s.path.map((p, k) => ({ name: `observer waypoint ${k + 1}`, kind: "observer", at: p, move: (x, y) => (s.path[k] = [x, y]), remove: s.path.length > 1 ? () => s.path.splice(k, 1) : null }));
    list.push({ name: "target at the first measurement", kind: "target", at: s.target.slice(0, 2), move: (x, y) => { s.target[0] = x; s.target[1] = y; } });
    list.push({ name: "target at the last measurement: its velocity", kind: "target", small: true, at: [s.target[0] + span * s.target[2], s.target[1] + span * s.target[3]], move: (x, y) => { s.target[2] = (x - s.target[0]) / span; s.target[3] = (y - s.target[1]) / span; } });
    return list;
  },
  extent(s) {
    const times = track.times(s), span = times[times.length - 1] - times[0];
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
    for (const { state } of more.tracks || []) view.line([place(state, 0), place(state, span)], "same");
    for (const region of more.regions || []) view.line(region.points, "region", region.closed);
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
    if (more.tracks && more.tracks.length) {
      const worst = Math.max(...more.tracks.map((t) => t.chi2).filter(isFinite));
      out.push(worst < 1e-6 ? "the dashed tracks give exactly the same measurements" : `equal to first order: along the dashed tracks chi2 rises by up to ${brief(worst)}`);
    }
    if (more.headings && more.headings.some(isFinite)) {
      const best = more.headings.indexOf(Math.min(...more.headings));
      out.push(`best next heading <b>${best * 10}°</b>: 1 sigma of the last place ${metres(more.headings[best])} after one more leg`);
    }
    if (s.measured) out.push(`${times(s)} measured bearings from a file: ${html(s.measured.status)}`);
    else out.push(`observer ${brief(way.speed)} m/s, target ${brief(Math.hypot(s.target[2], s.target[3]))} m/s, ${brief(((s.count - 1) * s.step) / 60)} min`);
    return out;
    function times(s) { return s.measured.times.length; }
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
    { kind: "range", label: "Measurements", key: "count", of: s, unit: "", low: 4, high: 200, whole: true, off: !!s.measured },
    { kind: "range", label: "One every", key: "step", of: s, unit: "s", low: 1, high: 60, whole: true, off: !!s.measured },
  ],
  buttons: (s) => [
    { label: "Add waypoint", run: () => { const a = s.path[s.path.length - 1], b = s.path[s.path.length - 2] || [a[0] - 800, a[1]]; s.path.push([a[0] - (b[1] - a[1]) * 0.6, a[1] + (b[0] - a[0]) * 0.6]); }, off: !!s.measured || s.path.length > 11 },
    { label: "Remove waypoint", run: () => s.path.pop(), off: !!s.measured || s.path.length < 2 },
    { play: true },
    { upload: true, label: "Load CSV", load: (text) => track.load(s, text) },
    ...(s.measured ? [{ label: "Drop the file", run: () => { s.path = thin(s.measured.path); s.measured = null; } }] : []),
  ],
  // time (s), x, y (m) of the observer, bearing (deg clockwise from north).
  load(s, text) {
    const rows = text.trim().split(/\r?\n/).filter((line) => line && !line.startsWith("#")).map((line) => line.split(/[,;\t]/).map((cell) => cell.trim()));
    if (rows.length < 5) throw new Error(`the file has ${Math.max(0, rows.length - 1)} rows: at least 4 bearings are needed`);
    const head = rows[0].map((name) => name.toLowerCase());
    const column = (what, pattern) => {
      const k = head.findIndex((name) => pattern.test(name));
      if (k < 0) throw new Error(`no column for ${what} among ${head.join(", ")}: needed are time, x, y (m) and bearing_deg`);
      return rows.slice(1).map((row, i) => {
        const value = Number(row[k]);
        if (row[k] === undefined || row[k] === "" || !isFinite(value)) throw new Error(`${head[k]}, row ${i + 2} = "${row[k] ?? ""}": must be a number`);
        return value;
      });
    };
    const t = column("time", /^t$|time|^t_/), x = column("x", /^x|east|_x/), y = column("y", /^y|north|_y/), b = column("bearing", /bear|brg|azim/);
    const radians = /rad/.test(head[head.findIndex((name) => /bear|brg|azim/.test(name))]);
    t.forEach((value, i) => { if (i && !(value > t[i - 1])) throw new Error(`time, row ${i + 2} = ${value} s: must be later than ${t[i - 1]} s`); });
    const next = { ...s, use: { bearing: true, range: false, frequency: false }, know: { position: false, speed: false }, measured: { times: t, path: x.map((v, i) => [v, y[i]]), values: b.map((v) => (radians ? v : v * DEGREE)), status: "", reason: "" } };
    track.fit(next);
    Object.assign(s, next);
  },
  // Without priors: where their means would be, a file does not say.
  fit(s) {
    const [found, [code, dof, p]] = ask("track_estimate", [...track.question(s), s.measured.values]), n = 4;
    const [cost, other] = found.slice(n * n + 3 * n);
    s.target = found.slice(0, n);
    const status = ["unobservable", "misfit", "not_converged", "ambiguous", "weak", "determined"][code];
    const reason = {
      unobservable: "the bearings leave a combination open",
      misfit: `chi2 = ${brief(cost, 4)} for ${dof} degrees of freedom (p = ${brief(p, 2)}): a straight track at constant speed does not fit`,
      not_converged: "the steps did not come to rest",
      ambiguous: `another solution fits as well: chi2 is larger by ${brief(other - cost, 2)}`,
      weak: "a position of the track is uncertain by a good part of its distance",
      determined: `one solution fits: chi2 = ${brief(cost, 4)} for ${dof} degrees of freedom (p = ${brief(p, 2)})`,
    }[status];
    Object.assign(s.measured, { status, reason });
  },
  python(s) {
    const way = track.way(s), t = s.measured ? list(s.measured.times) : `${s.step} * np.arange(${s.count})`;
    const sensors = SENSORS.filter(([k]) => s.use[k]).map(([k]) => `    gm.tracks.Sensor.${k}(observer, times, sigma=${k === "bearing" ? `np.radians(${s.sigma[k]})` : s.sigma[k]}${k === "frequency" ? `, speed=${s.wave}` : ""}),`);
    const prior = track.prior(s), names = track.names(s), known = names.filter((_, i) => isFinite(prior[i])).map((name) => `"${name}": ${prior[names.indexOf(name)]}`);
    const state = s.target.concat(s.use.frequency ? [s.tonal] : []);
    const lines = ["import gramian as gm", "import numpy as np", "", `times = ${s.measured ? `np.array(${t})` : t}`,
      `observer = gm.tracks.Carrier(${pairs(way.path)}, ${list(way.times)})`, "sensors = [", ...sensors, "]",
      "scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)",
      `state = {${names.map((name, i) => `"${name}": ${state[i]}`).join(", ")}}`,
      `problem = gm.tracks.problem(scene, state)${known.length ? `.prior({${known.join(", ")}})` : ""}`, "answer = gm.analyze(problem)", "print(answer.summary())"];
    if (s.measured) lines.push("", `bearings = np.array(${list(s.measured.values)})`, "print(gm.tracks.estimate(scene, [bearings]).summary())");
    return lines.join("\n") + "\n";
  },
  toml(s) {
    const way = track.way(s), state = s.target.concat(s.use.frequency ? [s.tonal] : []), names = track.names(s), prior = track.prior(s);
    const t = s.measured ? list(s.measured.times) : `{ first = 0.0, last = ${real((s.count - 1) * s.step)}, step = ${real(s.step)} }`;
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
const thin = (path) => { const step = Math.max(1, Math.ceil(path.length / 8)); return path.filter((_, k) => k % step === 0 || k === path.length - 1); };

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

// ---- a dipole that passes ----------------------------------------------------------------

const AXES = ["x", "y", "z"];
const dipole = {
  start: () => ({ r0: [-10, 6, 2], v: [1, -0.2, 0], m: [10, 20, 10], count: 41, step: 0.5, noise: 1, second: [4, -3, 0], two: false, know: "nothing", size: 1.2 }),
  names: () => ["x0", "y0", "z0", "vx", "vy", "vz", "mx", "my", "mz"],
  units: () => ["m", "m", "m", "m/s", "m/s", "m/s", "A m^2", "A m^2", "A m^2"],
  knowledge(s) {
    const unit = (v, first) => { const size = Math.hypot(...v), out = Array(9).fill(0); v.forEach((x, i) => (out[first + i] = x / size)); return out; };
    const one = (k) => { const out = Array(9).fill(0); out[k] = 1; return out; };
    return { "its speed": unit(s.v, 3), "the size of its moment": unit(s.m, 6), "how far aside (y0)": one(1), "its height (z0)": one(2) };
  },
  times: (s) => Array.from({ length: s.count }, (_, k) => k * s.step),
  sensors: (s) => (s.two ? [[0, 0, 0], s.second] : [[0, 0, 0]]),
  analyze(s) {
    const all = dipole.knowledge(s), known = all[s.know] || [];
    const [status, singular, flat, bound, repaired, scale, field, image, other, mirrored, scaled] = ask("dipole", [[...s.r0, ...s.v, ...s.m], dipole.times(s), [s.noise * 1e-9], dipole.sensors(s).flat(), known, Object.values(all).flat(), [s.size]]);
    const names = dipole.names(), nullSpace = vectors(flat, 9);
    const verdict = judge({ status, singular, nullSpace, data: bound, scale, prior: Array(9).fill(Infinity), names, units: dipole.units() });
    return { verdict, status, singular, nullSpace, bound, scale, repaired, field, image, other, mirrored, scaled, names, units: dipole.units(), state: [...s.r0, ...s.v, ...s.m] };
  },
  more: () => ({}),
  handles(s) {
    const span = (s.count - 1) * s.step;
    const out = [
      { name: "dipole at the first sample", kind: "target", at: s.r0.slice(0, 2), move: (x, y) => { s.r0[0] = x; s.r0[1] = y; } },
      { name: "dipole at the last sample: its velocity", kind: "target", small: true, at: [0, 1].map((i) => s.r0[i] + span * s.v[i]), move: (x, y) => { s.v[0] = (x - s.r0[0]) / span; s.v[1] = (y - s.r0[1]) / span; } },
    ];
    if (s.two) out.push({ name: "second sensor", kind: "observer", at: s.second.slice(0, 2), move: (x, y) => { s.second[0] = x; s.second[1] = y; } });
    return out;
  },
  extent: (s) => [[0, 0], s.r0, s.r0.map((x) => -x), [0, 1].map((i) => -s.r0[i] - (s.count - 1) * s.step * s.v[i]), [0, 1].map((i) => s.r0[i] + (s.count - 1) * s.step * s.v[i]), ...(s.two ? [s.second] : [])],
  draw(view, s, a, more, play) {
    const span = (s.count - 1) * s.step, end = (state) => [state[0] + span * state[3], state[1] + span * state[4]];
    if (a.nullSpace.length) view.line([a.scaled, end(a.scaled)], "same");
    view.line([a.mirrored, end(a.mirrored)], "ellipse");
    view.line([a.state, end(a.state)], "track");
    dipole.times(s).forEach((t) => view.dot([s.r0[0] + t * s.v[0], s.r0[1] + t * s.v[1]], "target", 1.8));
    dipole.sensors(s).forEach((p, k) => { view.dot(p, "observer mark", 7); view.label(p, k ? "second sensor" : "sensor"); });
    view.label(s.r0, "dipole"); view.label(a.mirrored, "mirror image");
    if (play !== null) view.dot([s.r0[0] + play * span * s.v[0], s.r0[1] + play * span * s.v[1]], "target mark", 7);
  },
  legend: (s, a) => "<span><i style='border-color:var(--target)'></i>pass, seen from above</span><span><i style='border-color:var(--soft);border-top-style:dashed'></i>mirror image</span>" + (a.nullSpace.length ? `<span><i style='border-color:var(--null);border-top-style:dashed'></i>a pass ${brief(s.size)} times as large</span>` : ""),
  facts(s, a) {
    const out = a.verdict.combinations.map((text) => `not observable: <b>${html(text)}</b>`);
    const worst = (other) => Math.max(...other.map((x, i) => Math.abs(x - a.field[i]))) / (s.noise * 1e-9);
    out.push(worst(a.image) < 1e-6 ? "the mirror image gives the same field: only knowledge of the side tells them apart" : `the mirror image differs by up to ${brief(worst(a.image))} sigma`);
    if (s.know === "nothing") out.push(worst(a.other) < 1e-6 ? `a pass ${brief(s.size)} times as large, with ${brief(s.size ** 3)} times the moment, gives the same field` : `a pass ${brief(s.size)} times as large differs by up to ${brief(worst(a.other))} sigma`);
    if (a.nullSpace.length) {
      const repairs = Object.keys(dipole.knowledge(s)).filter((_, k) => a.repaired[k] === 9);
      out.push(repairs.length ? `repaired by knowing <b>${repairs.join("</b>, or <b>")}</b>` : "no single one of the offered facts repairs it");
    }
    return out;
  },
  chart(s, a) {
    const width = 3 * dipole.sensors(s).length, pick = (values, k) => values.filter((_, i) => i % width === k).map((x) => x * 1e9);
    return { title: "Field at the sensor", note: "x, y and z components (nT) at the sensor in the origin; dotted: those of the mirror image.", unit: "nT", x: dipole.times(s), kind: "s",
      lines: [0, 1, 2].flatMap((k) => [{ y: pick(a.field, k), name: AXES[k], style: ["", "two", "three"][k] }, { y: pick(a.image, k), style: "image" }]) };
  },
  controls: (s) => [
    { kind: "choice", label: "Known exactly", options: ["nothing", ...Object.keys(dipole.knowledge(s))], value: s.know, set: (v) => (s.know = v) },
    { kind: "check", label: "A second sensor", key: "two", of: s },
    { kind: "range", label: "Noise", key: "noise", of: s, unit: "nT", low: 0.01, high: 100, log: true },
    ...["Height", "Climb"].map((label, k) => ({ kind: "range", label, key: 2, of: k ? s.v : s.r0, unit: k ? "m/s" : "m", low: k ? -1 : -10, high: k ? 1 : 10, step: k ? 0.05 : 0.5 })),
    ...AXES.map((axis, k) => ({ kind: "range", label: `Moment, ${axis}`, key: k, of: s.m, unit: "A m²", low: -50, high: 50, step: 1 })),
    { kind: "range", label: "Samples", key: "count", of: s, unit: "", low: 5, high: 200, whole: true },
    { kind: "range", label: "One every", key: "step", of: s, unit: "s", low: 0.1, high: 2, step: 0.1 },
    { kind: "range", label: "Size of another pass", key: "size", of: s, unit: "×", low: 0.5, high: 2, step: 0.05 },
  ],
  buttons: () => [{ play: true }],
  fixed: { "its speed": "speed", "the size of its moment": "moment", "how far aside (y0)": "y0", "its height (z0)": "z0" },
  python: (s) => ["import gramian as gm", "import numpy as np", "", `times = ${s.step} * np.arange(${s.count})`, `sensors = ${pairs(dipole.sensors(s))}`,
    `problem = gm.dipole.problem(${list(s.r0)}, ${list(s.v)}, ${list(s.m)}, times, ${s.noise}e-9, sensors=sensors)${dipole.fixed[s.know] ? `.fix("${dipole.fixed[s.know]}")` : ""}`, "print(gm.analyze(problem).summary())"].join("\n") + "\n",
  toml(s) {
    const known = { speed: Math.hypot(...s.v), moment: Math.hypot(...s.m), y0: s.r0[1], z0: s.r0[2] }, name = dipole.fixed[s.know];
    return ["# gramian analyze scene.toml", 'model = "dipole"', `sensors = ${pairs(dipole.sensors(s))}`, "", "[pass]", `r0 = ${list(s.r0)}`, `v = ${list(s.v)}`, `m = ${list(s.m)}`, `duration = ${real((s.count - 1) * s.step)}`, `step = ${real(s.step)}`, `sigma_nT = ${real(s.noise)}`, ...(name ? ["", "[known]", `${name} = ${real(known[name])}`] : [])].join("\n") + "\n";
  },
};

// ---- two radars ------------------------------------------------------------------------------

const radars = {
  start: () => ({ a: [0, 0], b: [60000, 0], from: [-10000, 25000], to: [60000, 45000], count: 100, range: 50, azimuth: 0.1, circle: 2000 }),
  names: () => ["A.range", "A.azimuth", "B.range", "B.azimuth"],
  units: () => ["m", "rad", "m", "rad"],
  sigma: (s) => [s.range, s.azimuth * DEGREE, s.range, s.azimuth * DEGREE],
  positions: (s) => Array.from({ length: s.count }, (_, k) => [0, 1].map((i) => s.from[i] + k * ((s.to[i] - s.from[i]) / (s.count - 1)))),
  analyze(s) {
    const [status, singular, flat, bound, degrees] = ask("radars", [[...s.a, ...s.b], radars.sigma(s), radars.positions(s).flat()]);
    const names = radars.names(), nullSpace = vectors(flat, 4), none = Array(4).fill(NaN);
    const verdict = judge({ status, singular, nullSpace, data: bound, scale: none, prior: Array(4).fill(Infinity), names, units: radars.units() });
    return { verdict, status, singular, nullSpace, bound, degrees, names, units: radars.units() };
  },
  more(s) {
    const box = view.box(), nx = 60, ny = Math.max(8, Math.round((nx * (box[3] - box[2])) / (box[1] - box[0])));
    const line = (low, high, n) => Array.from({ length: n }, (_, k) => low + ((k + 0.5) * (high - low)) / n);
    return { nx, ny, map: ask("radars_map", [[...s.a, ...s.b], radars.sigma(s), line(box[0], box[1], nx), line(box[2], box[3], ny), [s.circle]])[0] };
  },
  handles: (s) => [["a", "radar A", "observer"], ["b", "radar B", "observer"], ["from", "first place of the target", "target"], ["to", "last place of the target", "target"]].map(([key, name, kind]) => ({ name, kind, at: s[key], small: key === "to", move: (x, y) => (s[key] = [x, y]) })),
  extent: (s) => [s.a, s.b, s.from, s.to],
  draw(view, s, a, more, play) {
    if (more.map) heat(more);
    view.line([s.a, s.b], "ellipse");
    view.line([s.from, s.to], "track");
    radars.positions(s).forEach((p) => view.dot(p, "target", 1.8));
    view.label(s.a, "radar A"); view.label(s.b, "radar B"); view.label(s.from, "target");
    if (play !== null) view.dot([0, 1].map((i) => s.from[i] + play * (s.to[i] - s.from[i])), "target mark", 7);
  },
  legend(s, a, more) {
    const [low, high] = more.map ? shades(more.map) : [NaN, NaN];
    return `<span>Colour: degree eta of looks on a circle around each place, from ${brief(10 ** low, 2)} (dark) to ${brief(10 ** high, 2)} (bright), logarithmic</span>`;
  },
  facts(s, a) {
    const out = a.verdict.combinations.map((text) => `not observable: <b>${html(text)}</b>`);
    out.push(`degree eta of the track <b>${brief(a.degrees[a.degrees.length - 1])}</b> of at most 1`);
    out.push(`rank ${a.status[0]} of 4 from ${s.count} looks`);
    return out;
  },
  chart: (s, a) => ({ title: "Degree of observability along the track", note: "eta of all looks so far, between 0 and 1.", unit: "", x: a.degrees.map((_, k) => k + 1), lines: [{ y: a.degrees }], kind: "looks", zero: true }),
  controls: (s) => [
    { kind: "choice", label: "Example", options: ["", "Across", "Along the baseline: unobservable", "Far away"], set: (v) => v && replace(Object.assign(radars.start(), { Across: {}, "Along the baseline: unobservable": { from: [6000, 0], to: [54000, 0] }, "Far away": { from: [90000, 100000], to: [100000, 140000] } }[v])) },
    { kind: "range", label: "Noise of range", key: "range", of: s, unit: "m", low: 1, high: 500, log: true },
    { kind: "range", label: "Noise of azimuth", key: "azimuth", of: s, unit: "deg", low: 0.01, high: 2, log: true },
    { kind: "range", label: "Looks", key: "count", of: s, unit: "", low: 2, high: 300, whole: true },
    { kind: "range", label: "Circle of the map", key: "circle", of: s, unit: "m", low: 200, high: 20000, log: true },
  ],
  buttons: () => [{ play: true }],
  python: (s) => ["import gramian as gm", "import numpy as np", "", `positions = np.array(${list(s.from)}) + np.arange(${s.count})[:, None] * np.array(${list([0, 1].map((i) => (s.to[i] - s.from[i]) / (s.count - 1)))})`,
    `sensors = {"A": ${list(s.a)}, "B": ${list(s.b)}}`, `sigma = (${s.range}, np.radians(${s.azimuth}))`, "print(gm.analyze(gm.registration.problem(positions, sensors, sigma)).summary())", 'print("eta", gm.registration.eta(positions, sensors, sigma))'].join("\n") + "\n",
  toml: (s) => ["# gramian analyze scene.toml", 'model = "registration"', "", ...["a", "b"].flatMap((key) => [`[sensors.${key.toUpperCase()}]`, `east = ${real(s[key][0])}`, `north = ${real(s[key][1])}`, `sigma_range = ${real(s.range)}`, `sigma_azimuth_deg = ${real(s.azimuth)}`, ""]),
    "[tracks.target]", `start = ${list(s.from)}`, `velocity = ${list([0, 1].map((i) => (s.to[i] - s.from[i]) / (s.count - 1)))}`, `duration = ${real(s.count - 1)}`, "step = 1.0"].join("\n") + "\n",
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
  for (const { y, style } of lines) {
    let d = "", pen = false;
    y.forEach((v, k) => { const ok = isFinite(v) && (!log || v > 0); if (ok) d += `${pen ? "L" : "M"}${px(x[k]).toFixed(1)} ${Math.max(top, Math.min(h, py(v))).toFixed(1)}`; pen = ok; });
    parts.push(`<path class="curve ${style || ""}" d="${d}"/>`);
  }
  if (play !== null) { const at = left + play * (w - left - right); parts.push(`<line class="cursor" x1="${at}" x2="${at}" y1="${top}" y2="${h - bottom}"/>`); }
  svg.innerHTML = parts.join("");
}

// ---- the page -----------------------------------------------------------------------------------

const TABS = { track, dipole, radars };
const scenes = { track: track.start(), dipole: dipole.start(), radars: radars.start() };
let tab = "track", answer = null, more = {}, waiting = 0, play = null, ticking = 0, failed = "";

function replace(scene) { scenes[tab] = scene; fitView(); }
function fitView() { view.fit(TABS[tab].extent(scenes[tab])); }

// The answer at once; region, headings and map in the next frame, or where these take long
// as soon as the hand rests; the link a little later.
function update({ controls = false } = {}) {
  const now = performance.now();
  failed = "";
  try { answer = TABS[tab].analyze(scenes[tab]); } catch (error) { answer = null; failed = error.message; }
  explorer.took = performance.now() - now;
  more = answer && Object.keys(more).length ? keep(more) : {};
  show(controls);
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    if (!answer) return;
    const then = performance.now();
    try { more = TABS[tab].more(scenes[tab], answer); } catch (error) { more = {}; console.warn(error.message); }
    explorer.tookMore = performance.now() - then;
    show(false);
  }, explorer.tookMore > 8 ? 120 : 0);
  clearTimeout(update.link);
  update.link = setTimeout(remember, 250);
}
// Until the new one is there: the old map, not the old region.
const keep = (old) => (old.map ? old : {});

function show(controls) {
  const scene = scenes[tab], model = TABS[tab];
  const badge = $("verdict"), verdict = answer ? answer.verdict : { status: "no answer", tone: "bad", reason: failed };
  badge.className = verdict.tone; $("status").textContent = verdict.status; $("reason").textContent = verdict.reason;
  $("facts").innerHTML = answer ? model.facts(scene, answer, more).map((t) => `<li>${t}</li>`).join("") : "";
  $("bounds").innerHTML = answer ? "<tr><th>state</th>" + (answer.state ? "<th>value</th>" : "") + "<th>1 sigma at best</th></tr>" + answer.names.map((name, i) => {
    const bound = answer.bound[i], unit = answer.units[i];
    return `<tr><td>${name}</td>${answer.state ? `<td>${brief(answer.state[i], 4)} ${unit}</td>` : ""}<td class="${isFinite(bound) ? "" : "none"}">${isFinite(bound) ? `${brief(bound)} ${unit}` : "not observable"}</td></tr>`;
  }).join("") : "";
  $("heat").style.display = tab === "radars" ? "" : "none";
  view.begin(); if (tab !== "radars") view.grid();
  if (answer) model.draw(view, scene, answer, more, play);
  $("legend").innerHTML = answer ? model.legend(scene, answer, more) : "";
  drawMap(model.handles(scene));
  if (answer) drawChart(model.chart(scene, answer), play);
  if (controls) { drawControls(); drawBar(); }
  if (!$("code").hidden) $("code").textContent = model[$("code").dataset.kind](scene);
  $("cost").textContent = `${brief(explorer.took || 0, 2)} ms for the answer${explorer.tookMore ? `, ${brief(explorer.tookMore, 2)} ms for regions and headings` : ""}.`;
}

// The picture is written anew; handles stay, so that a drag and the focus survive.
function drawMap(handles) {
  const svg = $("map");
  let back = svg.querySelector("#back"), front = svg.querySelector("#front");
  if (!back) { svg.innerHTML = '<g id="back"></g><g id="front"></g>'; back = svg.querySelector("#back"); front = svg.querySelector("#front"); }
  back.innerHTML = view.parts.join("");
  while (front.children.length > handles.length) front.lastChild.remove();
  handles.forEach((handle, k) => {
    let node = front.children[k];
    if (!node) {
      node = document.createElementNS(SVG, "g");
      node.innerHTML = '<circle class="reach" r="22"/><circle class="dot" r="8"/>';
      node.setAttribute("tabindex", "0"); node.setAttribute("role", "button");
      front.append(node);
    }
    const [x, y] = view.to(handle.at);
    node.setAttribute("class", "handle"); node.dataset.index = k; node.dataset.name = handle.name;
    node.lastChild.setAttribute("class", `dot ${handle.kind}`); node.lastChild.setAttribute("r", handle.small ? 6 : 8.5);
    node.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)})`);
    node.setAttribute("aria-label", `${handle.name}: east ${brief(handle.at[0], 4)} m, north ${brief(handle.at[1], 4)} m`);
  });
}

function tidy(v) { const digits = 10 ** Math.max(0, Math.ceil(Math.log10(view.scale)) + 1); return Math.round(v * digits) / digits; }

function startDragging() {
  const svg = $("map"); let drag = null;
  svg.addEventListener("pointerdown", (event) => {
    const node = event.target.closest(".handle");
    if (!node) return;
    const [x, y] = view.to(TABS[tab].handles(scenes[tab])[node.dataset.index].at), box = svg.getBoundingClientRect();
    drag = { id: event.pointerId, index: Number(node.dataset.index), dx: x - (event.clientX - box.left), dy: y - (event.clientY - box.top) };
    svg.setPointerCapture(event.pointerId); node.focus({ preventScroll: true }); event.preventDefault(); stopPlaying();
  });
  svg.addEventListener("pointermove", (event) => {
    if (!drag || event.pointerId !== drag.id) return;
    const box = svg.getBoundingClientRect(), [x, y] = view.from(event.clientX - box.left + drag.dx, event.clientY - box.top + drag.dy);
    TABS[tab].handles(scenes[tab])[drag.index].move(tidy(x), tidy(y)); update();
  });
  const end = (event) => { if (drag && event.pointerId === drag.id) { drag = null; refit(); update(); } };
  svg.addEventListener("pointerup", end); svg.addEventListener("pointercancel", end);
  svg.addEventListener("keydown", (event) => {
    const node = event.target.closest(".handle");
    if (!node) return;
    const handle = TABS[tab].handles(scenes[tab])[node.dataset.index], by = view.metres(event.shiftKey ? 40 : 8);
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (way) { handle.move(tidy(handle.at[0] + by * way[0]), tidy(handle.at[1] + by * way[1])); refit(); update(); } else if (event.key === "Delete" && handle.remove) { handle.remove(); update({ controls: true }); } else return;
    event.preventDefault();
  });
}

// The view moves only where a handle has left it, or all are close together.
function refit() {
  const [w, h] = view.size(); view.size0 = [w, h];
  const at = TABS[tab].extent(scenes[tab]).map(view.to), xs = at.map((p) => p[0]), ys = at.map((p) => p[1]);
  if (at.some(([x, y]) => x < 20 || y < 20 || x > w - 20 || y > h - 20) || (Math.max(...xs) - Math.min(...xs) < 0.35 * w && Math.max(...ys) - Math.min(...ys) < 0.35 * h)) fitView();
}

function drawControls() {
  const box = $("controls"); box.textContent = "";
  TABS[tab].controls(scenes[tab]).forEach((c, k) => {
    const row = document.createElement("div"); row.className = "row";
    const id = `control-${k}`, label = document.createElement("label"); label.htmlFor = id; label.textContent = c.label;
    if (c.kind === "choice") {
      const select = document.createElement("select"); select.id = id;
      for (const option of c.options) select.add(new Option(option || "choose ...", option, false, option === c.value));
      select.addEventListener("change", () => { c.set(select.value); update({ controls: true }); });
      row.append(label, select);
    } else if (c.kind === "check") {
      const input = Object.assign(document.createElement("input"), { type: "checkbox", id, checked: c.of[c.key] });
      input.addEventListener("change", () => { c.of[c.key] = input.checked; fitView(); update(); });
      label.prepend(input); row.append(label);
    } else {
      const input = Object.assign(document.createElement("input"), { type: "range", id }), output = document.createElement("output");
      const steps = 200, ratio = c.high / c.low;
      if (c.log) Object.assign(input, { min: 0, max: steps, step: 1, value: Math.round((steps * Math.log(c.of[c.key] / c.low)) / Math.log(ratio)) });
      else Object.assign(input, { min: c.low, max: c.high, step: c.whole ? 1 : c.step, value: c.of[c.key] });
      const tell = () => { output.textContent = `${brief(c.of[c.key])} ${c.unit}`; input.setAttribute("aria-valuetext", output.textContent); };
      input.addEventListener("input", () => { c.of[c.key] = c.log ? Number((c.low * ratio ** (input.value / steps)).toPrecision(2)) : Number(input.value); tell(); if (scenes[tab].measured) refresh(); update(); });
      input.disabled = !!c.off; row.classList.toggle("off", !!c.off);
      if (c.check) {
        const check = Object.assign(document.createElement("input"), { type: "checkbox", checked: c.check[c.key] });
        check.setAttribute("aria-label", `use: ${c.label}`); check.dataset.use = c.key; row.classList.toggle("off", !c.check[c.key]);
        check.addEventListener("change", () => { c.check[c.key] = check.checked; row.classList.toggle("off", !check.checked); update(); });
        check.disabled = !!c.off || (!!scenes[tab].measured && c.check === scenes[tab].use);
        label.prepend(check);
      }
      tell(); row.append(label, input, output);
    }
    box.append(row);
  });
}

// Measured bearings with another sigma are another estimate.
function refresh() { try { track.fit(scenes.track); } catch (error) { failed = error.message; } }

function drawBar() {
  const bar = $("bar"); bar.textContent = "";
  for (const b of TABS[tab].buttons(scenes[tab])) {
    if (b.upload) {
      const label = document.createElement("label"), input = Object.assign(document.createElement("input"), { type: "file", accept: ".csv,.txt,text/csv" });
      label.className = "upload"; label.append(b.label, input); input.id = "csv"; label.title = "Columns time (s), x and y (m) of the observer, bearing_deg";
      input.addEventListener("change", async () => {
        try { b.load(await input.files[0].text()); fitView(); update({ controls: true }); } catch (error) { $("verdict").className = "bad"; $("status").textContent = "not read"; $("reason").textContent = error.message; }
      });
      bar.append(label);
    } else {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: b.play ? "Play" : b.label, disabled: !!b.off });
      if (b.play) { button.id = "play"; button.addEventListener("click", () => (play === null ? startPlaying() : stopPlaying())); } else button.addEventListener("click", () => { b.run(); refit(); update({ controls: true }); });
      bar.append(button);
    }
  }
  const again = Object.assign(document.createElement("button"), { type: "button", textContent: "Reset" });
  again.addEventListener("click", () => { replace(TABS[tab].start()); update({ controls: true }); });
  bar.append(again);
}

function startPlaying() {
  const began = performance.now(), length = 6000; $("play").textContent = "Stop";
  const tick = (now) => { play = Math.min(1, Math.max(0, (now - began) / length)); show(false); if (play < 1) ticking = requestAnimationFrame(tick); else stopPlaying(); };
  ticking = requestAnimationFrame(tick);
}
function stopPlaying() { cancelAnimationFrame(ticking); if (play !== null) { play = null; show(false); } if ($("play")) $("play").textContent = "Play"; }

// ---- links and files -------------------------------------------------------------------------------

function link() {
  const bytes = new TextEncoder().encode(JSON.stringify(scenes[tab]));
  let text = ""; for (const byte of bytes) text += String.fromCharCode(byte);
  return `#${tab}=${btoa(text).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "")}`;
}
function remember() { try { history.replaceState(null, "", link()); } catch { /* a page that may not: the link can be copied */ } }

// A scene from a link is somebody else's text: only numbers, words and lists of the kind that the
// scene has are taken.
function alike(given, own) {
  if (typeof own === "number") return typeof given === "number" && isFinite(given);
  if (Array.isArray(own)) return Array.isArray(given) && given.length > 0 && given.length < 5000 && given.every((x) => alike(x, own[0]));
  if (own !== null && typeof own === "object") return given !== null && typeof given === "object" && Object.keys(own).every((key) => key === "measured" || alike(given[key], own[key]));
  return typeof given === typeof own;
}
function recall() {
  const found = /^#(track|dipole|radars)=([\w-]+)$/.exec(location.hash);
  if (!found) return false;
  try {
    const text = atob(found[2].replace(/-/g, "+").replace(/_/g, "/"));
    const scene = JSON.parse(new TextDecoder().decode(Uint8Array.from(text, (c) => c.charCodeAt(0)))), own = TABS[found[1]].start();
    if (!alike(scene, own)) return false;
    const m = scene.measured;
    if (m && !(alike(m, { times: [0], path: [[0]], values: [0], status: "", reason: "" }) && m.times.length === m.path.length && m.times.length === m.values.length)) return false;
    tab = found[1]; scenes[tab] = Object.fromEntries(Object.keys(own).map((key) => [key, scene[key] ?? own[key]]));
    return true;
  } catch { return false; }
}

async function copy(text, what) {
  let done = true;
  try { await navigator.clipboard.writeText(text); } catch {
    const area = Object.assign(document.createElement("textarea"), { value: text }); document.body.append(area); area.select();
    done = document.execCommand("copy"); area.remove();
  }
  $("copied").textContent = done ? `${what} copied` : `${what} is below: copy it from there`;
}
function showCode(kind) {
  const code = $("code"); code.hidden = false; code.dataset.kind = kind; code.textContent = TABS[tab][kind](scenes[tab]);
  copy(code.textContent, kind === "toml" ? "TOML" : "Python");
}

function openTab(name) {
  stopPlaying(); tab = name; more = {};
  for (const other of Object.keys(TABS)) { const on = other === name; $(`tab-${other}`).setAttribute("aria-selected", on); $(`tab-${other}`).tabIndex = on ? 0 : -1; }
  $("work").setAttribute("aria-labelledby", `tab-${name}`);
  fitView(); update({ controls: true });
}

const explorer = { scenes, get answer() { return answer; }, get more() { return more; }, get tab() { return tab; }, models: TABS, ask, update, openTab, link };
window.explorer = explorer;

async function begin() {
  const bytes = Uint8Array.from(atob($("wasm").textContent), (c) => c.charCodeAt(0));
  wasm = (await WebAssembly.instantiate(bytes, {})).instance.exports;
  recall(); startDragging();
  for (const name of Object.keys(TABS)) {
    $(`tab-${name}`).addEventListener("click", () => openTab(name));
    $(`tab-${name}`).addEventListener("keydown", (event) => {
      const all = Object.keys(TABS), by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (by) { const next = all[(all.indexOf(name) + by + all.length) % all.length]; openTab(next); $(`tab-${next}`).focus(); }
    });
  }
  $("copy-python").addEventListener("click", () => showCode("python"));
  $("copy-toml").addEventListener("click", () => showCode("toml"));
  $("share").addEventListener("click", () => { remember(); copy(location.href.split("#")[0] + link(), "Link"); });
  window.addEventListener("hashchange", () => { if (location.hash !== link() && recall()) openTab(tab); });
  new ResizeObserver(() => { fitView(); update(); }).observe($("map"));
  openTab(tab);
  explorer.ready = true;
}
begin();
