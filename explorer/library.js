"use strict";
// The crate gramian as WebAssembly: plain arrays in, plain arrays out. The page and its worker
// both load this file; rust/gramian-explorer is the other side.

let wasm;

// Lists of numbers behind their lengths, there and back.
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

// Text is the bytes of UTF-8.
const bytes = (lines) => Array.from(new TextEncoder().encode(lines.join("\n")));
const lines = (list) => new TextDecoder().decode(Uint8Array.from(list)).split("\n");

// The answer, or what is wrong where there is none.
function askOne([name, lists]) {
  try { return { found: ask(name, lists) }; } catch (error) { return { error: error.message }; }
}
