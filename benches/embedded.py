"""What the C interface takes of a microcontroller.

    python benches/embedded.py

Builds the static library for a Cortex-M4F (`thumbv7em-none-eabihf`, opt-level "s"), links
one part alone out of it, and reads from the result the size of the code, the frames on the
stack and the chain of calls that takes most of it. Then counts, with callgrind on this
computer, the instructions of a pushed bearing and of an answer. Needs `rustup target add
thumbv7em-none-eabihf` and valgrind. Exit status 1 when the monitor exceeds its limits.
"""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import check

ROOT = Path(__file__).parent.parent
TARGET = "thumbv7em-none-eabihf"
FOLDER = ROOT / "target" / "embedded"
PARTS = {
    "monitor": ["gramian_monitor_init", "gramian_monitor_push", "gramian_monitor_answer"],
    "heading laws": ["gramian_heading"],
    "dipole": [
        "gramian_dipole_field",
        "gramian_dipole_jacobian",
        "gramian_dipole_sums_init",
        "gramian_dipole_sums_push",
        "gramian_dipole_sums_matrix",
    ],
}
# Bytes that the monitor may take.
FLASH, STACK = 24 * 1024, 2048


def run(*command: str | Path, **environment: str) -> str:
    """Give what a command prints, or end with what it complains of."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | environment,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))} failed:\n{done.stderr}")
    return done.stdout


def build() -> Path:
    """Build the static library."""
    if TARGET not in run("rustup", "target", "list", "--installed"):
        sys.exit(f"the target is missing: rustup target add {TARGET}")
    command = ["cargo", "rustc", "--quiet", "-p", "gramian-capi", "--profile", "embedded"]
    command += ["--no-default-features", "--features", "libm", "--crate-type", "staticlib"]
    command += ["--target", TARGET, "--target-dir", str(FOLDER)]
    # The sizes of frames are a flag of the nightly compiler that the stable one knows too.
    run(*command, RUSTC_BOOTSTRAP="1", RUSTFLAGS="-Z emit-stack-sizes")
    return FOLDER / TARGET / "embedded" / "libgramian_capi.a"


def link(library: Path, functions: list[str]) -> Image:
    """Link some functions and what they reach, nothing else."""
    linker = next(Path(run("rustc", "--print", "sysroot").strip()).rglob("rust-lld"))
    program = FOLDER / "part.elf"
    keep = [word for name in functions for word in ("-u", name)]
    flags = ["-flavor", "gnu", "--gc-sections", "-e", functions[0], *keep]
    run(linker, *flags, library, "-o", program)
    return Image(program)


class Image:
    """A linked 32-bit ELF file: its sections, functions, frames and calls."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        header = struct.unpack_from("<16sHHIIIIIHHHHHH", data)
        start, size, count, names = header[6], header[11], header[12], header[13]
        raw = [struct.unpack_from("<10I", data, start + size * i) for i in range(count)]

        def text(table: tuple[int, ...], at: int) -> str:
            at += table[4]
            return data[at : data.index(b"\0", at)].decode()

        # By name: flags, address, content.
        self.sections = {
            text(raw[names], s[0]): (s[2], s[3], data[s[4] : s[4] + s[5]]) for s in raw
        }
        symbols = next(s for s in raw if s[1] == 2)
        # By address: name and length.
        self.functions: dict[int, tuple[str, int]] = {}
        for at in range(symbols[4], symbols[4] + symbols[5], 16):
            name, value, length, info = struct.unpack_from("<IIIB", data, at)
            if info & 15 == 2 and length:
                self.functions[value & ~1] = (text(raw[symbols[6]], name), length)
        self.frames = dict(self._frames())
        self.calls = self._calls()

    def _frames(self) -> Iterator[tuple[int, int]]:
        data, at = self.sections[".stack_sizes"][2], 0
        while at < len(data):
            (address,) = struct.unpack_from("<I", data, at)
            at, size, shift = at + 4, 0, 0
            while True:
                size |= (data[at] & 127) << shift
                at, shift = at + 1, shift + 7
                if data[at - 1] < 128:
                    break
            yield address & ~1, size

    def _calls(self) -> dict[int, set[int]]:
        """Where each function branches to: bl and b.w of the Thumb-2 encoding."""
        _, base, code = self.sections[".text"]
        found = defaultdict(set)
        for start, (_, length) in self.functions.items():
            at = start
            while at < start + length:
                (high,) = struct.unpack_from("<H", code, at - base)
                if high >> 11 < 0b11101:
                    at += 2
                    continue
                (low,) = struct.unpack_from("<H", code, at + 2 - base)
                if high >> 11 == 0b11110 and low & 0x9000 == 0x9000:
                    sign, j1, j2 = high >> 10 & 1, low >> 13 & 1, low >> 11 & 1
                    offset = (j1 ^ sign ^ 1) << 23 | (j2 ^ sign ^ 1) << 22
                    offset |= (high & 0x3FF) << 12 | (low & 0x7FF) << 1
                    to = at + 4 + offset - (sign << 24)
                    if to in self.functions and to != start:
                        found[start].add(to)
                at += 4
        return found

    def loaded(self, flag: int = 2) -> int:
        """Bytes of the sections that are loaded and have a flag: 1 write, 4 execute."""
        return sum(
            len(data) for flags, _, data in self.sections.values() if flags & 2 and flags & flag
        )

    def deepest(self, start: int) -> list[int]:
        """The chain of calls that takes most stack. No function here calls itself."""
        below = max((self.deepest(to) for to in self.calls[start]), key=self.stack, default=[])
        return [start, *below]

    def stack(self, chain: list[int]) -> int:
        """Bytes that a chain of calls takes. A frame is 0 where it is not told."""
        return sum(self.frames.get(at, 0) for at in chain)

    def name(self, at: int) -> str:
        """Give the last two words of a mangled name."""
        name = self.functions[at][0]
        rest, words = re.sub(r"Cs[0-9A-Za-z]+_", "", name), []
        while found := re.search(r"[0-9]+", rest):
            length, rest = int(found.group()), rest[found.end() :].removeprefix("_")
            words.append(rest[:length])
            rest = rest[length:]
        words = [word for word in words if word != "gramian_capi"]
        return "::".join(words[-2:]) if name.startswith("_R") else name


def report(part: str, image: Image, functions: list[str]) -> bool:
    """Print what a part takes, and say whether it keeps the monitor's limits."""
    at = {name: address for address, (name, _) in image.functions.items()}
    chain = max((image.deepest(at[name]) for name in functions), key=image.stack)
    largest = max(image.frames, key=image.frames.__getitem__)
    steps = (f"{image.name(a)} {image.frames[a]}" for a in chain if a in image.frames)
    panics = {address for name, address in at.items() if "9panicking" in name}
    callers = {image.name(a) for a in image.calls if image.calls[a] & panics and a not in panics}
    print(f"\n{part}: {image.loaded():,} bytes of flash, {image.loaded(1)} of memory")
    by_size = sorted(image.functions.items(), key=lambda item: -item[1][1])
    for address, (_, length) in by_size[:6]:
        print(f"  {length:6,} {image.name(address)}")
    print(f"  stack: {image.stack(chain)} bytes ({', '.join(steps)})")
    print(f"  largest frame: {image.frames[largest]} bytes, {image.name(largest)}")
    print(f"  index checks kept in: {', '.join(sorted(callers)) or 'none'}")
    return image.loaded() <= FLASH and image.stack(chain) <= STACK


def main() -> None:
    library = build()
    print(f"{run('rustc', '--version').strip()}, {TARGET}, opt-level s, LTO")
    good = [report(part, link(library, names), names) for part, names in PARTS.items()]
    program = check.build()
    print()
    for name, title in [
        ("monitor_push_f32_1000", "a pushed bearing"),
        ("monitor_answer_f32_1000", "an answer"),
    ]:
        count = check.instructions(program, name, 3) - check.instructions(program, name, 2)
        print(f"{title}: {count // 1000:,} instructions (callgrind, this computer)")
    sys.exit(not good[0])


if __name__ == "__main__":
    main()
