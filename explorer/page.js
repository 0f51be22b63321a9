// ---- the page -----------------------------------------------------------------------------------

const TABS = { track, dipole, radars };
const scenes = { track: track.start(), dipole: dipole.start(), radars: radars.start() };
let tab = "track", answer = null, more = {}, play = null, ticking = 0, failed = "";

function replace(scene) { scenes[tab] = scene; fitView(); }
function fitView() { view.fit(TABS[tab].extent(scenes[tab])); }

// At once: the answer and, in TIME_OF_A_DRAG (ms), what the model can say soon. In the background
// what takes longer; the link a little later.
const TIME_OF_A_DRAG = 10;
let serial = 0;
function update({ controls = false } = {}) {
  const began = performance.now(), now = ++serial, model = TABS[tab], scene = scenes[tab];
  failed = "";
  try { answer = model.analyze(scene); } catch (error) { answer = null; failed = error.message; }
  const then = answer, asked = tab, waiting = answer ? model.soon(scene, answer) : {}, there = {};
  for (const [name, question] of Object.entries(waiting)) {
    if (performance.now() - began > TIME_OF_A_DRAG) break;
    there[name] = askOne(question).found;
    delete waiting[name];
  }
  Object.assign(waiting, answer ? model.later(scene, answer) : {});
  const soon = answer ? model.gather(scene, answer, there) : {}, shown = "regions" in soon || "tracks" in soon;
  // What else is there is of a moment ago, of the same kind at least.
  const kind = answer && `${tab} ${answer.nullSpace.length}`;
  more = { ...(answer && more.kind === kind ? more : { kind }), ...soon, stale: !shown, partial: true };
  explorer.took = performance.now() - began;
  const names = Object.keys(waiting);
  if (!names.length) explorer.tookMore = 0;
  show(controls);
  explorer.drew = performance.now() - began;
  if (names.length) background.ask(Object.values(waiting), (answers, took, whole) => {
    if (asked !== tab || scene !== scenes[tab] || more.kind !== kind) return;
    const found = model.gather(scene, then, { ...there, ...Object.fromEntries(answers.map((one, k) => [names[k], one.found])) });
    // Of a scene that has moved on: what was not shown at once.
    more = now === serial ? { ...more, ...found, stale: false, partial: !whole } : { ...found, ...more, ...("intervals" in found ? { intervals: found.intervals } : {}) };
    explorer.tookMore = took; explorer.problems = answers.map(({ error }) => error).filter(Boolean);
    if (answer) show(false);
    if (whole && now === serial) explorer.settled = now;
  });
  else { background.drop(); more = { ...more, stale: false, partial: false }; explorer.settled = now; }
  clearTimeout(update.link);
  update.link = setTimeout(remember, 250);
}

function show(controls) {
  const scene = scenes[tab], model = TABS[tab];
  const badge = $("verdict"), verdict = answer ? answer.verdict : { status: "no answer", tone: "bad", reason: failed };
  badge.className = verdict.tone; $("status").textContent = verdict.status; $("reason").textContent = verdict.reason;
  $("facts").innerHTML = answer ? model.facts(scene, answer, more).map((t) => `<li>${t}</li>`).join("") : "";
  $("bounds").innerHTML = answer ? boundsTable() : "";
  $("heat").style.display = tab === "radars" ? "" : "none";
  view.begin(); if (tab !== "radars") view.grid();
  if (answer) model.draw(view, scene, answer, more, play);
  $("legend").innerHTML = answer ? model.legend(scene, answer, more) : "";
  drawMap(model.handles(scene));
  if (answer) drawChart(model.chart(scene, answer), play);
  if (controls) { drawControls(); drawBar(); }
  if (!$("code").hidden) $("code").textContent = model[$("code").dataset.kind](scene);
  $("cost").textContent = `${brief(explorer.took || 0, 2)} ms for the answer${explorer.tookMore ? `, ${brief(explorer.tookMore, 2)} ms beside it for the rest` : ""}.`;
}

// Each state: its value, the bound, and where there is one the interval of the likelihood.
function boundsTable() {
  const wanted = tab === "track" && !answer.nullSpace.length, intervals = wanted && more.intervals && more.intervals.length === answer.names.length ? more.intervals : null;
  const head = ["state", ...(answer.state ? ["value"] : []), wanted ? "1 sigma" : "1 sigma at best", ...(wanted ? ["95 % interval"] : [])];
  const end = (x, digits) => (isFinite(x) ? brief(x, digits) : "open");
  return `<tr>${head.map((text) => `<th>${text}</th>`).join("")}</tr>` + answer.names.map((name, i) => {
    const bound = answer.bound[i], unit = answer.units[i], pieces = intervals && vectors(intervals[i], 2);
    const cells = [name, ...(answer.state ? [`${brief(answer.state[i], 4)} ${unit}`] : [])];
    const interval = !wanted ? "" : pieces ? `<td class="${more.stale || more.partial ? "old" : ""}">${pieces.map(([low, high]) => `${end(low, 4)} to ${end(high, 4)}`).join("<br>or ")}</td>` : "<td>...</td>";
    return `<tr>${cells.map((text) => `<td>${text}</td>`).join("")}<td class="${isFinite(bound) ? "" : "none"}">${isFinite(bound) ? `${brief(bound)} ${unit}` : "not observable"}</td>${interval}</tr>`;
  }).join("");
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
      const input = Object.assign(document.createElement("input"), { type: "checkbox", id, checked: c.of[c.key], disabled: !!c.off });
      input.addEventListener("change", () => { c.of[c.key] = input.checked; fitView(); update(); });
      label.prepend(input); row.append(label);
    } else {
      const input = Object.assign(document.createElement("input"), { type: "range", id }), output = document.createElement("output");
      const steps = 200, ratio = c.high / c.low;
      if (c.log) Object.assign(input, { min: 0, max: steps, step: 1, value: Math.round((steps * Math.log(c.of[c.key] / c.low)) / Math.log(ratio)) });
      else Object.assign(input, { min: c.low, max: c.high, step: c.whole ? 1 : c.step, value: c.of[c.key] });
      const tell = () => { output.textContent = `${brief(c.of[c.key])} ${c.unit}`; input.setAttribute("aria-valuetext", output.textContent); };
      input.addEventListener("input", () => { c.of[c.key] = c.log ? Number((c.low * ratio ** (input.value / steps)).toPrecision(2)) : Number(input.value); tell(); if (scenes[tab].measured) refresh(); update({ controls: false }); });
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

// Measurements with another sigma are another estimate.
function refresh() { try { TABS[tab].fit(scenes[tab]); } catch (error) { failed = error.message; } }

function drawBar() {
  const bar = $("bar"); bar.textContent = "";
  for (const b of TABS[tab].buttons(scenes[tab])) {
    if (b.upload) {
      const label = document.createElement("label"), input = Object.assign(document.createElement("input"), { type: "file", accept: ".csv,.txt,text/csv" });
      label.className = "upload"; label.append(b.label, input); input.id = "csv"; label.title = `CSV: ${b.hint}`;
      input.addEventListener("change", async () => {
        const file = input.files[0];
        if (!file) return;
        try {
          if (file.size > 4e6) throw new Error(`${brief(file.size / 1e6)} MB: the explorer reads files up to 4 MB`);
          b.load(await file.text()); fitView(); update({ controls: true });
        } catch (error) { $("verdict").className = "bad"; $("status").textContent = "not read"; $("reason").textContent = `${file.name}: ${error.message}`; $("facts").innerHTML = `<li>A file has ${html(b.hint)}. The scene is as it was.</li>`; }
        input.value = "";
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
function remember() {
  if (host) { host.postMessage({ gramian: "scene", tab, scene: scenes[tab], toml: TABS[tab].toml(scenes[tab]), status: $("status").textContent }, "*"); return; }
  try { history.replaceState(null, "", link()); } catch { /* a page that may not: the link can be copied */ }
}

// A scene from a link is somebody else's text: only numbers, words and lists of the kind that the
// scene has are taken.
function alike(given, own) {
  if (typeof own === "number") return typeof given === "number" && isFinite(given);
  if (Array.isArray(own)) return Array.isArray(given) && given.length < 20000 && given.every((x) => alike(x, own[0]));
  if (own !== null && typeof own === "object") return given !== null && typeof given === "object" && Object.keys(own).every((key) => alike(given[key], own[key]));
  return typeof given === typeof own;
}
// The scene of a tab, checked: what it may lack is null there.
function checked(name, scene) {
  const own = TABS[name].start(), may = TABS[name].optional, out = {};
  if (scene === null || typeof scene !== "object") return null;
  for (const key of Object.keys(own)) {
    const value = scene[key] ?? null;
    if (key in may ? value !== null && !alike(value, may[key]) : !alike(value, own[key]) || (Array.isArray(own[key]) && !value.length)) return null;
    out[key] = value;
  }
  if (out.measured && out.measured.other === undefined) out.measured.other = scene.measured.other;
  const m = out.measured;
  if (m && name === "track" && (m.times.length !== m.path.length || m.times.length !== m.values.length || !alike(m.other ?? [], [0]))) return null;
  if (m && name === "dipole" && (!out.times || m.values.length !== 3 * out.times.length)) return null;
  if (out.times && out.times.length < 2) return null;
  return out;
}
function recall() {
  const found = /^#(track|dipole|radars)=([\w-]+)$/.exec(location.hash);
  if (!found) return false;
  try {
    const text = atob(found[2].replace(/-/g, "+").replace(/_/g, "/"));
    return take(found[1], JSON.parse(new TextDecoder().decode(Uint8Array.from(text, (c) => c.charCodeAt(0)))));
  } catch { return false; }
}
// Opens a scene that came from elsewhere; of bearings or a field without an estimate it is found.
function take(name, given) {
  const scene = name in TABS && checked(name, given);
  if (!scene) return false;
  const estimated = scene.measured && (name === "track" ? scene.measured.status : scene.measured.said);
  if (scene.measured && !estimated) {
    try { if (name === "track") track.measure(scene, scene.measured); else dipole.fit(scene); } catch (error) { failed = error.message; }
  }
  tab = name; scenes[name] = scene;
  return true;
}

// The page in a frame of a notebook, or with a scene of its own: what is around it gives the
// scene, and hears of each change.
const host = window.parent !== window ? window.parent : null;
function given() {
  const text = $("scene").textContent.trim();
  if (!text || text.startsWith("/*")) return false;
  const { tab: name, scene } = JSON.parse(text);
  return take(name, scene);
}
window.addEventListener("message", ({ source, data }) => {
  if (!host || source !== host || !data || data.gramian !== "open") return;
  if (take(data.tab, data.scene)) openTab(tab);
  else host.postMessage({ gramian: "refused", tab: data.tab }, "*");
});

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

const explorer = { scenes, get answer() { return answer; }, get more() { return more; }, get tab() { return tab; }, get calm() { return explorer.settled === serial && !background.busy && !background.next; }, models: TABS, ask, update, show, openTab, link };
window.explorer = explorer;

async function begin() {
  const program = Uint8Array.from(atob($("wasm").textContent), (c) => c.charCodeAt(0));
  background.module = await WebAssembly.compile(program);
  wasm = (await WebAssembly.instantiate(background.module, {})).exports;
  background.begin();
  if (!given()) recall();
  startDragging();
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
  explorer.ready = true; explorer.first = performance.now();
  if (host) host.postMessage({ gramian: "ready" }, "*");
}
begin();
