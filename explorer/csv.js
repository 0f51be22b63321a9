// ---- files -----------------------------------------------------------------------------

// A table of numbers: the columns whose headings match, by name, and their headings. What is
// missing or is no number is said with its row.
function table(text, wanted, { least = 2, most = 5000 } = {}) {
  const rows = text.replace(/^\uFEFF/, "").split(/\r?\n/).map((line, k) => ({ line: line.trim(), at: k + 1 })).filter(({ line }) => line && !line.startsWith("#"));
  if (!rows.length) throw new Error("the file is empty");
  const mark = [";", "\t", ","].find((sign) => rows[0].line.includes(sign)) || ",";
  const cells = rows.map(({ line, at }) => ({ at, cells: line.split(mark).map((cell) => cell.trim().replace(/^"(.*)"$/, "$1")) }));
  const head = cells[0].cells.map((name) => name.toLowerCase()), body = cells.slice(1);
  const need = Object.entries(wanted).map(([, { label }]) => label).join(", ");
  if (head.every((name) => name !== "" && isFinite(Number(name)))) throw new Error(`line ${cells[0].at} has numbers: the first line must name the columns ${need}`);
  const out = { headings: {}, rows: body.length };
  for (const [key, { label, pattern }] of Object.entries(wanted)) {
    const found = head.map((name, k) => [name, k]).filter(([name]) => pattern.test(name));
    if (!found.length) throw new Error(`no column for ${label} among ${head.join(", ")}: needed are ${need}`);
    if (found.length > 1) throw new Error(`${found.map(([name]) => name).join(" and ")} may both be ${label}: name one of them so`);
    const [name, k] = found[0];
    out.headings[key] = name;
    out[key] = body.map((row) => {
      const cell = row.cells[k], value = Number(cell);
      if (cell === undefined || cell === "" || !isFinite(value)) throw new Error(`${name}, line ${row.at} = "${cell ?? ""}": must be a number`);
      return value;
    });
  }
  if (body.length < least) throw new Error(`the file has ${body.length} rows below its headings: at least ${least} are needed`);
  if (body.length > most) throw new Error(`the file has ${body.length} rows: the explorer takes ${most}; gm.analyze takes all`);
  if (out.time) out.time.forEach((value, i) => { if (i && !(value > out.time[i - 1])) throw new Error(`${out.headings.time}, line ${body[i].at} = ${value} s: must be later than ${out.time[i - 1]} s`); });
  out.line = (i) => body[i].at;
  return out;
}
const TIME = { label: "time", pattern: /^(t|t_s|time.*|seconds?|sec)$/ };
