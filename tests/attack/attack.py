"""Call every public function with arguments gone wrong, and see that each call answers.

An answer is a result without NaN, an error of this package that says what was wrong, or a
MemoryError. Everything else is a finding: a panic, a crash, a hang, NaN in silence, an
exception of another kind.

    python tests/attack/attack.py --calls 100000 [--seed 0] [--only bearings.rows,dipole]

Call i depends on (seed, i) alone: `--first 1234 --calls 1` repeats one.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import math
import os
import random
import select
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

import gramian as gm
from attack.baselines import CALLS, METHODS, public

#: A call may take so much processor time, seconds; and so long where others run as well.
PATIENCE, WALL = 5.0, 25.0
#: So many times that where the processor was not given, as for a call that sleeps.
PATIENT = 12
#: A worker may have so much address space, bytes.
MEMORY = 8 << 30

SPECIAL = (
    float("nan"),
    float("inf"),
    float("-inf"),
    0.0,
    -0.0,
    -1.0,
    1e308,
    -1e308,
    5e-324,
    1e-300,
    1e300,
    1e-8,
    1e8,
    2.0**53,
)
WHOLE = (0, 1, -1, 2, 7, 2**31, 2**63 - 1, 2**63, 2**64, -(2**70), 10**9, 10**10, 2**50, 10**400)
KINDS: tuple[Any, ...] = (
    None,
    True,
    False,
    "junk",
    "",
    b"bytes",
    1j,
    [],
    {},
    (),
    object(),
    Ellipsis,
    np.ma.masked,
    Decimal("1.5"),
    np.array([1.0, 2.0]),
    np.array("text"),
    np.datetime64("2020-01-01"),
    [None],
    [[1.0], [1.0, 2.0]],
    {"junk": 1.0},
    {1: 2},
    lambda *_: None,
    int,
    range(3),
    set("ab"),
    "\x1b]0;x\x07",
)
DTYPES = ("f4", "f2", "i8", "i1", "u8", "?", "c16", "O", "U8", ">f8", "M8[s]")


def of_array(rng: random.Random, value: np.ndarray) -> Any:
    """Return an array with one thing changed: a number, type, layout, mask or shape."""
    value = value.copy()
    if value.dtype.kind not in "fi":
        return rng.choice(KINDS)
    kind = rng.choice(("number", "number", "scale", "dtype", "layout", "mask", "shape", "kind"))
    if kind == "number" and value.size:
        value = value.astype(float)
        value.flat[rng.randrange(value.size)] = rng.choice(SPECIAL)
        return value
    if kind == "scale":
        with np.errstate(all="ignore"):
            return value * rng.choice((0.0, -1.0, 1e300, 1e-300, 1e160, 1e-160, 1e9, np.inf))
    if kind == "dtype":
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.nan_to_num(value).astype(rng.choice(DTYPES))
    if kind == "layout":
        which = rng.randrange(7)
        if which == 0:
            return np.asfortranarray(value)
        if which == 1 and value.ndim:
            return value[::-1].copy()[::-1]
        if which == 2:
            value.flags.writeable = False
            return value
        if which == 3:
            packed = np.zeros(value.shape, dtype=[("skip", "i1"), ("x", "f8")])
            packed["x"] = value
            return packed["x"]
        if which == 4:
            return value.tolist()
        if which == 5:
            return np.repeat(value[..., None], 2, axis=-1)[..., 0]
        return memoryview(np.ascontiguousarray(value, dtype=float))
    if kind == "mask":
        mask = np.zeros(value.shape, dtype=bool)
        if value.size and rng.random() < 0.7:
            mask.flat[rng.randrange(value.size)] = True
        return np.ma.masked_array(value, mask=mask)
    if kind == "shape":
        which = rng.randrange(9)
        if which == 0:
            return value[..., :-1] if value.ndim else value[None]
        if which == 1:
            return value[None]
        if which == 2:
            return np.zeros((*value.shape[:-1], 0))
        if which == 3:
            return value.T
        if which == 4:
            return np.array(value.flat[0] if value.size else 0.0)
        if which == 5:
            return np.broadcast_to(value, (3, *value.shape))
        if which == 6 and value.ndim:
            return np.concatenate([value, value])
        if which == 7 and value.ndim:
            return value[:1]
        return np.zeros((0, *value.shape[1:]))
    return rng.choice(KINDS)


def mutated(rng: random.Random, value: Any) -> Any:
    """Return a value in the place of one that works."""
    if rng.random() < 0.15:
        # What a function of the caller's raises is its own: no other function for it.
        return rng.choice([kind for kind in KINDS if not (callable(value) and callable(kind))])
    if isinstance(value, np.ndarray):
        return of_array(rng, value)
    if isinstance(value, bool) or value is None:
        return rng.choice((*KINDS, *SPECIAL))
    if isinstance(value, int):
        return rng.choice((*WHOLE, *SPECIAL)) if rng.random() < 0.8 else rng.choice(KINDS)
    if isinstance(value, float):
        return rng.choice((*SPECIAL, *WHOLE)) if rng.random() < 0.8 else rng.choice(KINDS)
    if isinstance(value, Mapping) and value:
        changed = dict(value)
        key = rng.choice(list(changed))
        which = rng.randrange(4)
        if which == 0:
            changed[rng.choice(("junk", 1, None, ""))] = changed[key]
        elif which == 1:
            changed.pop(key)
        else:
            changed[key] = mutated(rng, changed[key])
        return changed
    if isinstance(value, (tuple, list)) and value:
        items = list(value)
        at = rng.randrange(len(items))
        which = rng.randrange(5)
        if which == 0:
            items.pop(at)
        elif which == 1:
            items.append(items[at])
        else:
            items[at] = mutated(rng, items[at])
        return tuple(items) if isinstance(value, tuple) else items
    if callable(value) and not isinstance(value, type):
        junk: Any = rng.choice((float("nan"), 1e308, None, "x", np.zeros((2, 2, 2)), [1.0], 1j))
        return rng.choice((lambda *_, **__: junk, None, 5))
    return rng.choice((*KINDS, *SPECIAL))


def targets() -> dict[str, tuple[Any, dict[str, Any]]]:
    """What is called, by name: a function of no arguments that gives it, and the arguments."""
    functions = public()
    found: dict[str, tuple[Any, dict[str, Any]]] = {
        name: ((lambda f=function: f), CALLS[name])
        for name, function in functions.items()
        if name in CALLS
    }
    for name, (make, arguments) in METHODS.items():
        method = name.split(".")[1]
        found[name] = ((lambda make=make, method=method: getattr(make(), method)), arguments)
    return found


def nan_places(value: Any, place: str = "", depth: int = 0) -> Iterator[str]:
    """The attributes of a result that hold NaN."""
    if depth > 4:
        return
    if isinstance(value, float):
        if math.isnan(value):
            yield place
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and np.isnan(value).any():
            yield place
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            if field.name.startswith("_"):
                continue
            inner = getattr(value, field.name, None)
            yield from nan_places(inner, f"{place}.{field.name}", depth + 1)
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from nan_places(inner, f"{place}{{}}", depth + 1)
    elif isinstance(value, (tuple, list)):
        for inner in value:
            yield from nan_places(inner, f"{place}()", depth + 1)
    elif hasattr(value, "logdet"):
        for name in ("det", "logdet", "p_value", "statistic", "crlb_std"):
            yield from nan_places(getattr(value, name, None), f"{place}.{name}", depth + 1)


def called(function: Any, arguments: Mapping[str, Any]) -> Any:
    named = {key: value for key, value in arguments.items() if key != "*"}
    return function(*arguments.get("*", ()), **named)


def short(value: Any) -> str:
    text = repr(value).replace("\n", " ")
    return text if len(text) < 160 else text[:157] + "..."


COUNTS = ("trials", "count", "samples", "points", "starts", "restarts", "iterations")
#: Where a unit of work takes milliseconds, a user's own function for one.
SLOW = (
    "estimate",
    "other_solutions",
    "bounds.",
    "localize",
    "registration.",
    "tracks.",
    "maneuver.",
)
#: NaN that has a meaning: a state without a scale, the error of a trial without estimate.
MEANT = (".error", ".nees", ".std", ".scale", ".problem.scale", "{}.scale")
#: The same of single functions, by a part of their name; each is documented there.
MEANT_OF = {
    # A choice without `relax`.
    "choose.select": (".within",),
    "registration.select": (".within",),
    # A trial without degrees of freedom, or that did not converge.
    "estimate_trials": (".p_values", ".states", ".chi2", ".chances", ".alternatives{}"),
    # A disturbance has no first guess.
    "maneuver.plan": (".starts().guess",),
    "maneuver.soonest": (".plan.starts().guess",),
    "maneuver.shortest_interval": (".plan.starts().guess",),
    # A state without a prior, an output without a noise.
    "linear.": (".prior", ".noise"),
    "inertial.": (".prior", ".noise"),
    # A run none of whose trials could be used.
    "monte_carlo.sweep": tuple(
        f".results().{name}"
        for name in (
            "bias",
            "bias_interval",
            "std_interval",
            "rmse",
            "rmse_interval",
            "rmse_dof",
            "covariance",
            "covariance_interval",
            "efficiency",
            "efficiency_interval",
        )
    ),
    # A report or a reading that is missing.
    "registration.estimate": (".model.reports",),
    "tracks.": (".measurements",),
    "estimate": (".measurements",),
    # The state where there is no estimate: unobservable, or the model does not hold.
    "bearings.localize_many": (".state",),
}


def is_meant(name: str, place: str) -> bool:
    """Say whether NaN at a place of what a function returns is documented."""
    return place.endswith(MEANT) or any(
        part in name and place.endswith(places) for part, places in MEANT_OF.items()
    )


class Attack:
    """The calls of one seed."""

    def __init__(self, seed: int, only: str = "") -> None:
        self.seed = seed
        self.targets = {
            k: v for k, v in sorted(targets().items()) if any(part in k for part in only.split(","))
        }
        self.names = list(self.targets)
        self.known: dict[str, set[str]] = {}

    def call(self, index: int) -> tuple[str, str, Any, dict[str, Any]]:
        """What call `index` is: the function's name, the changed argument, both."""
        rng = random.Random(f"{self.seed}:{index}")
        name = self.names[index % len(self.names)]
        make, arguments = self.targets[name]
        changed = dict(arguments)
        keys = list(arguments)
        if not keys:
            return name, "", make, changed
        # Mostly one argument; now and then two.
        chosen = rng.sample(keys, min(len(keys), 2 if rng.random() < 0.1 else 1))
        for key in chosen:
            value = arguments[key]
            if key == "*":  # a sequence by Python's own rule
                at = rng.randrange(len(value))
                changed[key] = (*value[:at], mutated(rng, value[at]), *value[at + 1 :])
                continue
            changed[key] = mutated(rng, value)
            most = 30 if any(part in name for part in SLOW) else 1000
            if key in COUNTS and type(changed[key]) in (int, float) and changed[key] > most:
                # Work in proportion, which a user may want: what is beyond reason stays.
                changed[key] = most if changed[key] < 2**45 else changed[key]
        return name, "+".join(chosen), make, changed

    def judge(self, index: int) -> tuple[str, str]:
        """What came of a call: "result", "refused", "memory", or the kind of a finding."""
        name, key, make, arguments = self.call(index)
        if name not in self.known:
            base = called(make(), self.targets[name][1])
            self.known[name] = set(nan_places(base))
        label = f"{name}({key})"
        given = "; ".join(f"{k}={short(arguments[k])}" for k in key.split("+") if k)
        began = time.process_time()
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                result = called(make(), arguments)
        except gm.GramianError:
            outcome, detail = "refused", ""
        except MemoryError:
            outcome, detail = "memory", ""
        except Exception as error:
            outcome, detail = "foreign", f"{type(error).__name__}: {error}"
        except BaseException as error:
            outcome, detail = "panic", f"{type(error).__name__}: {error}"
        else:
            bad = [
                place
                for place in nan_places(result)
                if place not in self.known[name] and not is_meant(name, place)
            ]
            outcome, detail = ("nan", ", ".join(bad[:3]) or "result") if bad else ("result", "")
        if (spent := time.process_time() - began) > PATIENCE:
            outcome, detail = "hang", f"{spent:.1f} s"
        return outcome, f"#{index} {label} {given}: {detail}" if detail else ""


def work(seed: int, first: int, calls: int, only: str) -> None:
    """Run calls in this process and write a line for each; the parent watches."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    attack = Attack(seed, only)
    out = os.fdopen(os.dup(1), "w", buffering=1)
    sys.stdout = open(os.devnull, "w")
    print(json.dumps(["ready"]), file=out)
    for index in range(first, first + calls):
        print(json.dumps(["call", index]), file=out)
        print(json.dumps(["done", index, *attack.judge(index)]), file=out)


@dataclasses.dataclass
class Report:
    """What the calls came to."""

    outcomes: collections.Counter[str]
    findings: list[tuple[str, str]]

    def table(self) -> str:
        """The outcomes, and the findings by kind and place."""
        lines = [f"{count:8}  {kind}" for kind, count in self.outcomes.most_common()]
        places: collections.Counter[tuple[str, str]] = collections.Counter()
        example: dict[tuple[str, str], str] = {}
        for kind, detail in self.findings:
            place = (kind, detail.split(" ")[1] if detail.startswith("#") else detail)
            places[place] += 1
            example.setdefault(place, detail)
        lines += [f"{n:6} {kind:8} {example[kind, at]}" for (kind, at), n in places.most_common()]
        return "\n".join(lines)


def processor(pid: int) -> float:
    """Return the processor time that a process has taken, s; 0 where nobody says."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(  # noqa: PLR0915
    calls: int, seed: int = 0, only: str = "", first: int = 0, report: Report | None = None
) -> Report:
    """Run the calls in a process of their own, started again where it dies or hangs."""
    report = report or Report(collections.Counter(), [])
    end = first + calls
    while first < end:
        command = [sys.executable, "-X", "faulthandler", __file__, "--work", "--seed", str(seed)]
        command += ["--first", str(first), "--calls", str(end - first), "--only", only]
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=Path(__file__).parents[1],
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        )
        assert process.stdout is not None
        assert process.stderr is not None
        os.set_blocking(process.stderr.fileno(), False)
        running, buffer, errors = first, b"", b""
        began, waited = 0.0, 0
        why, patience = "crash", 10 * WALL  # the start takes long where others run as well
        while True:
            ready, _, _ = select.select([process.stdout], [], [], patience)
            errors = (errors + (process.stderr.read() or b""))[-2000:]
            if not ready:
                # Where others run as well, what counts is the processor's time.
                waited += 1
                idle = patience == WALL and processor(process.pid) - began < PATIENCE
                if idle and waited < PATIENT:
                    continue
                process.kill()
                why = "hang"
                break
            began, waited = processor(process.pid), 0
            data = os.read(process.stdout.fileno(), 1 << 16)
            if not data:
                break
            buffer += data
            *lines, buffer = buffer.split(b"\n")
            for line in lines:
                message = json.loads(line)
                patience = WALL
                if message[0] == "call":
                    running = message[1]
                elif message[0] == "done":
                    _, index, outcome, detail = message
                    report.outcomes[outcome] += 1
                    first = index + 1
                    if detail:
                        report.findings.append((outcome, detail))
        process.wait()
        process.stdout.close()
        process.stderr.close()
        if first < end:
            attack = Attack(seed, only)
            name, key, _, arguments = attack.call(running)
            given = "; ".join(f"{k}={short(arguments[k])}" for k in key.split("+") if k)
            last = errors.decode(errors="replace").strip().splitlines()[-1:]
            report.outcomes[why] += 1
            report.findings.append((why, f"#{running} {name}({key}) {given}: {last}"))
            first = running + 1
    return report


def main() -> int:
    """Run as a command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--work", action="store_true")
    options = parser.parse_args()
    if options.work:
        work(options.seed, options.first, options.calls, options.only)
        return 0
    began = time.monotonic()
    report = Report(collections.Counter(), [])
    try:
        run(options.calls, options.seed, options.only, options.first, report)
    except KeyboardInterrupt:
        print("stopped")
    print(report.table())
    print(f"{options.calls} calls in {time.monotonic() - began:.0f} s")
    return int(bool(report.findings))


if __name__ == "__main__":
    sys.exit(main())
