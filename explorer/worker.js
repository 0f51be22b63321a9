// The worker: answers what takes long, away from the page, each question as soon as it is answered.
onmessage = async ({ data }) => {
  if (data.module) { wasm = (await WebAssembly.instantiate(data.module, {})).exports; return; }
  const began = performance.now(), answers = [];
  for (const question of data.questions) {
    answers.push(askOne(question));
    postMessage({ answers, took: performance.now() - began, whole: answers.length === data.questions.length });
  }
};
