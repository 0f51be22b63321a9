// ---- a dipole that passes ----------------------------------------------------------------

const AXES = ["x", "y", "z"];
const dipole = {
  start: () => ({ r0: [-10, 6, 2], v: [1, -0.2, 0], m: [10, 20, 10], count: 41, step: 0.5, noise: 1, first: [0, 0, 0], second: [4, -3, 0], two: false, know: "nothing", size: 1.2, times: null, measured: null }),
  optional: { times: [0], measured: { values: [0], said: "", fit: [0] } },
  names: () => ["x0", "y0", "z0", "vx", "vy", "vz", "mx", "my", "mz"],
  units: () => ["m", "m", "m", "m/s", "m/s", "m/s", "A m^2", "A m^2", "A m^2"],
  knowledge(s) {
    const unit = (v, first) => { const size = Math.hypot(...v), out = Array(9).fill(0); v.forEach((x, i) => (out[first + i] = x / size)); return out; };
    const one = (k) => { const out = Array(9).fill(0); out[k] = 1; return out; };
    return { "its speed": unit(s.v, 3), "the size of its moment": unit(s.m, 6), "how far aside (y0)": one(1), "its height (z0)": one(2) };
  },
  times: (s) => s.times || Array.from({ length: s.count }, (_, k) => k * s.step),
  span: (s) => { const times = dipole.times(s); return times[times.length - 1] - times[0]; },
  sensors: (s) => (s.two ? [s.first, s.second] : [s.first]),
  analyze(s) {
    const all = dipole.knowledge(s), known = all[s.know] || [];
    const names = dipole.names(), units = dipole.units();
    const [said, status, singular, flat, bound, repaired, scale, field, image, other, mirrored, scaled] = ask("dipole", [[...s.r0, ...s.v, ...s.m], dipole.times(s), [s.noise * 1e-9], dipole.sensors(s).flat(), known, Object.values(all).flat(), [s.size], s.measured ? s.measured.fit : [], bytes(names), bytes(units)]);
    const verdict = verdictOf(said), nullSpace = vectors(flat, 9);
    return { verdict, status, singular, nullSpace, bound, scale, repaired, field, image, other, mirrored, scaled, names, units, state: [...s.r0, ...s.v, ...s.m] };
  },
  soon: () => ({}),
  later: () => ({}),
  gather: () => ({}),
  handles(s) {
    const span = dipole.span(s), sensor = (name, at) => ({ name, kind: "observer", at: at.slice(0, 2), move: (x, y) => { at[0] = x; at[1] = y; } });
    if (s.measured) return [];
    const out = [
      { name: "dipole at the first sample", kind: "target", at: s.r0.slice(0, 2), move: (x, y) => { s.r0[0] = x; s.r0[1] = y; } },
      { name: "dipole at the last sample: its velocity", kind: "target", small: true, at: [0, 1].map((i) => s.r0[i] + span * s.v[i]), move: (x, y) => { s.v[0] = (x - s.r0[0]) / span; s.v[1] = (y - s.r0[1]) / span; } },
    ];
    if (s.two) out.push(sensor("second sensor", s.second));
    return out;
  },
  extent: (s) => { const span = dipole.span(s), end = [0, 1].map((i) => s.r0[i] + span * s.v[i]), image = (p) => [0, 1].map((i) => 2 * s.first[i] - p[i]); return [...dipole.sensors(s), s.r0, end, image(s.r0), image(end)]; },
  draw(view, s, a, more, play) {
    const span = dipole.span(s), times = dipole.times(s), end = (state) => [state[0] + span * state[3], state[1] + span * state[4]];
    if (a.nullSpace.length) view.line([a.scaled, end(a.scaled)], "same");
    if (!s.two) view.line([a.mirrored, end(a.mirrored)], "ellipse");
    view.line([a.state, end(a.state)], "track");
    times.forEach((t) => view.dot([0, 1].map((i) => s.r0[i] + (t - times[0]) * s.v[i]), "target", 1.8));
    dipole.sensors(s).forEach((p, k) => { view.dot(p, "observer mark", 7); view.label(p, k ? "second sensor" : "sensor"); });
    view.label(s.r0, "dipole"); if (!s.two) view.label(a.mirrored, "mirror image");
    if (play !== null) view.dot([s.r0[0] + play * span * s.v[0], s.r0[1] + play * span * s.v[1]], "target mark", 7);
  },
  legend: (s, a) => "<span><i style='border-color:var(--target)'></i>pass, seen from above</span><span><i style='border-color:var(--soft);border-top-style:dashed'></i>mirror image</span>" + (a.nullSpace.length ? `<span><i style='border-color:var(--null);border-top-style:dashed'></i>a pass ${brief(s.size)} times as large</span>` : ""),
  facts(s, a) {
    const out = a.verdict.combinations.map((text) => `not observable: <b>${html(text)}</b>`);
    const worst = (other) => Math.max(...other.map((x, i) => Math.abs(x - a.field[i]))) / (s.noise * 1e-9);
    if (s.measured) out.push(`the pass that fits best: ${html(s.measured.said)}`);
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
    const seen = s.measured ? [0, 1, 2].map((k) => ({ y: pick(s.measured.values, k), dots: ["", "two", "three"][k] })) : [];
    const note = s.measured ? "x, y and z components (nT): points as measured, less what stays the same; lines as fitted." : "x, y and z components (nT) at the sensor; dotted: those of the mirror image.";
    return { title: "Field at the sensor", note, unit: "nT", x: dipole.times(s), kind: "s",
      lines: [...[0, 1, 2].flatMap((k) => [{ y: pick(a.field, k), name: AXES[k], style: ["", "two", "three"][k] }, ...(s.measured ? [] : [{ y: pick(a.image, k), style: "image" }])]), ...seen] };
  },
  controls: (s) => [
    { kind: "choice", label: "Known exactly", options: ["nothing", ...Object.keys(dipole.knowledge(s))], value: s.know, set: (v) => (s.know = v) },
    { kind: "check", label: "A second sensor", key: "two", of: s, off: !!s.measured },
    { kind: "range", label: "Noise", key: "noise", of: s, unit: "nT", low: 0.01, high: 100, log: true },
    ...["Height", "Climb"].map((label, k) => ({ kind: "range", label, key: 2, of: k ? s.v : s.r0, unit: k ? "m/s" : "m", low: k ? -1 : -10, high: k ? 1 : 10, step: k ? 0.05 : 0.5, off: !!s.measured })),
    ...AXES.map((axis, k) => ({ kind: "range", label: `Moment, ${axis}`, key: k, of: s.m, unit: "A m²", low: Math.min(-50, 2 * s.m[k]), high: Math.max(50, 2 * s.m[k]), step: Math.max(1, Math.abs(s.m[k])) / 100, off: !!s.measured })),
    { kind: "range", label: "Samples", key: "count", of: s, unit: "", low: 5, high: 200, whole: true, off: !!s.times },
    { kind: "range", label: "One every", key: "step", of: s, unit: "s", low: 0.1, high: 2, step: 0.1, off: !!s.times },
    { kind: "range", label: "Size of another pass", key: "size", of: s, unit: "×", low: 0.5, high: 2, step: 0.05 },
  ],
  buttons: (s) => [
    { play: true },
    { upload: true, label: "Load CSV", hint: "columns time (s), bx, by, bz (nT, or uT or T where the headings say so)", load: (text) => dipole.load(s, text) },
    ...(s.measured ? [{ label: "Drop the record", run: () => (s.measured = null) }] : []),
  ],
  // A recorded field of one sensor: the pass that fits best, and whether it fits.
  load(s, text) {
    const axis = (x) => ({ label: `b${x}`, pattern: new RegExp(`^(b_?${x}|mag_?${x}|field_?${x}|${x})(_.*|\\W.*)?$`) });
    const read = table(text, { time: TIME, x: axis("x"), y: axis("y"), z: axis("z") }, { least: 6 });
    const factor = ["x", "y", "z"].map((k) => (/_?ut\b|µt|\but/.test(read.headings[k]) ? 1e-6 : /(_|\W)t\W?$/.test(read.headings[k]) ? 1 : 1e-9));
    const values = read.time.flatMap((_, i) => ["x", "y", "z"].map((k, c) => read[k][i] * factor[c]));
    const next = { ...s, times: read.time, two: false, know: "nothing", measured: { values, said: "", fit: [] } };
    dipole.fit(next);
    Object.assign(s, next);
  },
  fit(s) {
    const [state, offset, fit, values, said] = ask("dipole_fit", [s.times, s.measured.values, [s.noise * 1e-9], s.first]);
    Object.assign(s, { r0: state.slice(0, 3), v: state.slice(3, 6), m: state.slice(6) });
    s.measured = { values: values.length ? values : s.measured.values, fit, said: lines(said)[0] };
    return offset;
  },
  fixed: { "its speed": "speed", "the size of its moment": "moment", "how far aside (y0)": "y0", "its height (z0)": "z0" },
  python: (s) => ["import gramian as gm", "import numpy as np", "", `times = ${s.times ? `np.array(${list(s.times)})` : `${s.step} * np.arange(${s.count})`}`, `sensors = ${pairs(dipole.sensors(s))}`,
    `problem = gm.dipole.problem(${list(s.r0)}, ${list(s.v)}, ${list(s.m)}, times, ${s.noise}e-9, sensors=sensors)${dipole.fixed[s.know] ? `.fix("${dipole.fixed[s.know]}")` : ""}`, "print(gm.analyze(problem).summary())",
    ...(s.measured ? ["", `field = np.array(${list(s.measured.values)}).reshape(-1, 3)  # T`, "# The size of a pass is open: this speed is one of many.", `found = gm.dipole.localize(times, field, sigma=${s.noise}e-9, background="fit", loss="gaussian", window=None, known={"speed": ${Math.hypot(...s.v)}})`, "print(found.summary())"] : [])].join("\n") + "\n",
  toml(s) {
    const known = { speed: Math.hypot(...s.v), moment: Math.hypot(...s.m), y0: s.r0[1], z0: s.r0[2] }, name = dipole.fixed[s.know], span = dipole.span(s), count = dipole.times(s).length;
    return ["# gramian analyze scene.toml", ...(s.times ? ["# At equal steps over the time of the samples."] : []), 'model = "dipole"', `sensors = ${pairs(dipole.sensors(s))}`, "", "[pass]", `r0 = ${list(s.r0)}`, `v = ${list(s.v)}`, `m = ${list(s.m)}`, `duration = ${real(s.times ? span : (s.count - 1) * s.step)}`, `step = ${real(s.times ? span / (count - 1) : s.step)}`, `sigma_nT = ${real(s.noise)}`, ...(name ? ["", "[known]", `${name} = ${real(known[name])}`] : [])].join("\n") + "\n";
  },
};
