// ---- in the background -----------------------------------------------------------------

// What takes long is asked of a worker, one set of questions at a time and of those that wait the
// newest alone: a drag never waits. Answers are shown as they come; a set that takes longer than
// PATIENCE (ms) while a newer one waits is given up: its worker ends, and another begins.
const PATIENCE = 150;
const background = {
  worker: null, module: null, busy: null, next: null, timer: 0,
  begin() {
    try {
      const text = `${$("library").textContent}\n${$("worker").textContent}`;
      background.worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
      background.worker.onmessage = ({ data }) => background.end(data);
      background.worker.onerror = () => { background.worker = null; background.busy = null; background.go(); };
      background.worker.postMessage({ module: background.module });
    } catch { background.worker = null; }
  },
  ask(questions, done) { background.next = { questions, done }; background.go(); },
  go() {
    clearTimeout(background.timer);
    if (background.busy) {
      if (background.next) background.timer = setTimeout(background.giveUp, Math.max(0, background.busy.since + PATIENCE - performance.now()));
      return;
    }
    if (!background.next) return;
    background.busy = Object.assign(background.next, { since: performance.now() });
    background.next = null;
    if (background.worker) background.worker.postMessage({ questions: background.busy.questions });
    else background.timer = setTimeout(background.here, 120);  // where no worker may be: when the hand rests
  },
  here() {
    if (background.next) { background.busy = null; background.go(); return; }
    const began = performance.now(), answers = background.busy.questions.map(askOne);
    background.end({ answers, took: performance.now() - began, whole: true });
  },
  giveUp() { background.worker.terminate(); background.busy = null; background.begin(); background.go(); },
  drop() { background.next = null; if (background.busy) background.busy.done = () => {}; },
  end({ answers, took, whole }) {
    if (!background.busy) return;
    const { done } = background.busy;
    if (whole) { background.busy = null; background.go(); }
    done(answers, took, whole);
  },
};
