"""Where chunks run: here, on processes of ours, or on an executor that was given."""

from __future__ import annotations

import concurrent.futures as cf
import itertools
import os
import pickle
import signal
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Generator, Iterable, Iterator
from typing import Any

from gramian import _core
from gramian.exceptions import InputError, WorkerError
from gramian.monte_carlo.chunks import Chunk, Task

__all__ = ["check_sendable", "execute"]

Span = tuple[int, int]

#: Breaks of a process pool in a row, without a chunk done, that are put up with.
MOST_BREAKS = 3
#: Times that one chunk is tried on workers that die or lose it.
MOST_TRIES = 6


def execute(
    task: Task,
    spans: Iterable[Span],
    count: int,
    workers: int | None,
    executor: cf.Executor | None,
) -> Generator[Chunk]:
    """Run the chunks `spans` (first trial, trials), yielding each as it is done.

    In order where they run here; in any order on workers. `count` is about how
    many there are.
    """
    if executor is not None:
        yield from _Workers(task, executor).run(spans)
    elif task.in_rust:
        before = _core.set_threads(workers) if workers is not None else None
        try:
            threads = _core.threads()
            if threads == 1 or count == 1:
                yield from _one_by_one(task, spans)
            else:
                yield from _on_threads(task, spans, count, threads)
        finally:
            if before is not None:
                _core.set_threads(before)
    elif workers is None:
        yield from _one_by_one(task, spans)
    else:
        yield from _Workers(task, workers).run(spans)


def _one_by_one(task: Task, spans: Iterable[Span]) -> Iterator[Chunk]:
    for span in spans:
        yield task.run(*span)


def _on_threads(task: Task, spans: Iterable[Span], count: int, threads: int) -> Iterator[Chunk]:
    """Run several chunks at a time.

    Many chunks have a thread each, which never waits for another. A few are
    shared by all threads, two at a time, so that there is work while one is
    summed up.
    """
    alone = count >= 4 * threads
    slots = threads if alone else 2
    stopped = threading.Event()

    def check() -> None:
        if stopped.is_set():
            raise cf.CancelledError

    # Waking for every chunk would hold up the workers; on the disk, though, each
    # is wanted at once.
    group = 1 if task.keep else 2 * slots
    rest = iter(spans)
    running: deque[cf.Future[Chunk]] = deque()
    with cf.ThreadPoolExecutor(slots, "gramian", _core.be_worker, (alone, check)) as executor:
        try:
            while True:
                for span in itertools.islice(rest, group + 2 * slots - len(running)):
                    running.append(executor.submit(task.run, *span))
                if not running:
                    return
                group = min(group, len(running))
                running[group - 1].exception()
                for _ in range(group):
                    yield running.popleft().result()
        finally:
            stopped.set()
            for future in running:
                future.cancel()


def check_sendable(task: Task) -> None:
    """Refuse what cannot be sent to another process.

    Raises
    ------
    InputError
    """
    try:
        pickle.dumps(task)
    except Exception as error:
        raise InputError(
            f"the run cannot be sent to a worker process: {error}; estimators, quantities and "
            "experiments must be importable (defined at the top of a module, not inside a "
            "function, no lambda), or run with workers = None or on threads"
        ) from error


class _Workers:
    """Chunks on an executor, with a bounded number under way."""

    def __init__(self, task: Task, executor: cf.Executor | int) -> None:
        self.task = task
        self.own = isinstance(executor, int)
        if isinstance(executor, int):
            check_sendable(task)
            self.executor: cf.Executor = _pool(executor)
        else:
            if isinstance(executor, cf.ProcessPoolExecutor):
                check_sendable(task)
            self.executor = executor
        count = getattr(self.executor, "_max_workers", None)
        self.window = 4 * count if isinstance(count, int) else 256
        self.running: dict[cf.Future[Chunk], Span] = {}
        self.tries: Counter[Span] = Counter()
        self.breaks = 0
        self.started = False

    def run(self, spans: Iterable[Span]) -> Iterator[Chunk]:
        """Yield the chunks as they are done."""
        rest, again = iter(spans), deque[Span]()
        try:
            while True:
                broken = False
                while len(self.running) < self.window and not broken:
                    span = again.popleft() if again else next(rest, None)
                    if span is None:
                        break
                    broken = not self._submit(span)
                    if broken:
                        again.appendleft(span)
                if not self.running and not broken:
                    return
                done, _ = cf.wait(self.running, return_when=cf.FIRST_COMPLETED)
                # In the order of the trials, for the sake of steady progress.
                for future in sorted(done, key=self.running.__getitem__):
                    span = self.running.pop(future)
                    chunk = self._result(future, span)
                    if isinstance(chunk, Chunk):
                        self.breaks = 0
                        yield chunk
                    else:
                        again.append(span)
                        broken = broken or chunk == "broken"
                if broken:
                    again.extend(self.running.values())
                    self.running.clear()
                    again = deque(sorted(again))
                    self._renew(again)
        except BaseException:
            self._abandon()
            raise
        finally:
            if self.own:
                self.executor.shutdown(wait=True)

    def _submit(self, span: Span) -> bool:
        """Submit a chunk; False if the workers turn out to be dead."""
        try:
            future = self.executor.submit(_run, self.task, *span)
        except cf.BrokenExecutor:
            return False
        except Exception as error:
            if self.started:
                raise WorkerError(f"the executor stopped taking work: {error}") from error
            raise InputError(
                f"executor takes no work ({error}): must not be shut down or closed"
            ) from error
        self.started = True
        self.running[future] = span
        return True

    def _result(self, future: cf.Future[Chunk], span: Span) -> Chunk | str:
        """Return the chunk; "broken" or "lost" if it must be run again."""
        try:
            result = future.result()
            if isinstance(result, Chunk):
                return result
            raise WorkerError(
                f"the executor returned a {type(result).__name__} for {_range([span])}: must be "
                "what the function that it was given returns"
            )
        except cf.BrokenExecutor:
            return "broken"
        except cf.CancelledError as error:
            lost: Exception = error
        except Exception as error:
            if not type(error).__module__.startswith("distributed"):
                raise
            if type(error).__name__ == "KilledWorker":
                raise WorkerError(f"{_range([span])} killed every worker: {error}") from error
            lost = error
        self.tries[span] += 1
        if self.tries[span] >= MOST_TRIES:
            raise WorkerError(
                f"{_range([span])} were lost {MOST_TRIES} times by the executor"
                f"{f': {lost}' if str(lost) else ''}"
            ) from lost
        return "lost"

    def _renew(self, unfinished: deque[Span]) -> None:
        """Go on with new processes after one of them was killed."""
        self.breaks += 1
        spans = list(unfinished)
        self.tries.update(spans)
        if self.breaks >= MOST_BREAKS or max(self.tries[s] for s in spans) >= MOST_TRIES:
            raise WorkerError(
                f"worker processes died {self.breaks} times while running {_range(spans)}: does "
                "the estimator end the process, or does it run out of memory? (Where processes "
                'are spawned, a script needs `if __name__ == "__main__":`.)'
            )
        if not isinstance(self.executor, cf.ProcessPoolExecutor):
            raise WorkerError(
                f"the executor broke while running {_range(spans)}: its workers are gone"
            )
        count, context = self.executor._max_workers, self.executor._mp_context  # type: ignore[attr-defined]
        if not self.own:
            warnings.warn(
                "a worker of the executor died; its chunks are run again on a new pool of "
                f"{count} processes",
                RuntimeWarning,
                stacklevel=2,
            )
        self.executor.shutdown(wait=False)
        self.executor, self.own = _pool(count, context), True

    def _abandon(self) -> None:
        """Stop at once what is under way."""
        for future in self.running:
            future.cancel()
        if self.own and isinstance(self.executor, cf.ProcessPoolExecutor):
            for process in list((self.executor._processes or {}).values()):
                process.terminate()


def _run(task: Task, first: int, trials: int) -> Chunk:
    return task.run(first, trials)


def _pool(count: int, context: Any = None) -> cf.ProcessPoolExecutor:
    import multiprocessing

    return cf.ProcessPoolExecutor(count, context or multiprocessing.get_context(), _begin)


def _begin() -> None:
    """Prepare a worker process: one thread, deaf to Ctrl-C, gone with its parent."""
    _core.set_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _range(spans: list[Span]) -> str:
    first, last = min(s[0] for s in spans), max(s[0] + s[1] for s in spans) - 1
    return f"trials {first} to {last}"
