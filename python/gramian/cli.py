"""The command `gramian`."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.status import Status

from gramian.exceptions import GramianError, InputError, ScenarioError, StorageError
from gramian.report import Report
from gramian.reproduce import PAPERS

__all__ = ["main"]

app = typer.Typer(
    help="What measurements can and cannot determine, how accurately, and what to do about it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

File = Annotated[
    Path, typer.Argument(metavar="FILE.toml", help="The scenario.", show_default=False)
]
Out = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write report.html and result.json here.", show_default=False),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


def _version(wanted: bool) -> None:
    if wanted:
        from gramian._core import __version__

        sys.stdout.write(f"gramian {__version__}\n")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Say which version this is."
        ),
    ] = False,
) -> None:
    """Take what stands before a command; the help is the application's own."""


@app.command()
def analyze(file: File, out: Out = None, json: Json = False) -> None:
    """Say what the measurements of a scenario determine, and what not."""
    from gramian.scenario import load

    with _in(file):
        report = load(file).analyze()
    _finish(report, out, json)


@app.command()
def localize(file: File, out: Out = None, json: Json = False) -> None:
    """Estimate from the recorded measurements of a scenario."""
    from gramian.scenario import load

    with _in(file):
        report = load(file).localize()
    _finish(report, out, json)


@app.command()
def plan(file: File, out: Out = None, json: Json = False) -> None:
    """Choose the observer's path of a scenario so as to know the most."""
    from gramian.scenario import load

    with _in(file):
        report = load(file).plan()
    _finish(report, out, json)


@app.command()
def simulate(
    file: File,
    trials: Annotated[int, typer.Option(help="How many.")] = 1000,
    seed: Annotated[int, typer.Option(help="Of the random numbers; any run can be repeated.")] = 1,
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Keep finished trials here and go on from them.",
            show_default=False,
        ),
    ] = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Estimate in many simulated trials and set the errors beside the bound."""
    from gramian.scenario import load

    try:
        report = load(file).simulate(trials, seed, resume=resume, progress=not json)
    except KeyboardInterrupt as stop:
        for note in getattr(stop, "__notes__", ()):
            Console(stderr=True, soft_wrap=True).print(_plain(note), highlight=False)
        raise
    _finish(report, out, json)


@app.command()
def demo(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where the scenarios and reports go.")
    ] = Path("gramian-demo"),
) -> None:
    """Analyse three ships that ship with the package: easy, hopeless, impossible."""
    from gramian.scenario import load

    console = Console()
    scenarios = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        with as_file(files("gramian") / "demo") as folder:
            for source in sorted(folder.iterdir()):
                # What a reader has edited stays.
                if source.suffix in {".toml", ".csv"} and not (out / source.name).exists():
                    shutil.copyfile(source, out / source.name)
                if source.suffix == ".toml":
                    scenarios.append(out / source.name)
    except OSError as error:
        raise StorageError(f"cannot write the demo to {out}: {error}") from error
    for scenario in scenarios:
        console.rule(f"gramian analyze {scenario}", align="left", style="dim")
        _finish(load(scenario).analyze(), out / scenario.stem, json=False)
    console.print("\nEdit a scenario and run its line again, or point one at your own tracks.")


@app.command()
def reproduce(
    name: Annotated[
        str, typer.Argument(help=f"A paper ({', '.join(PAPERS)}), or all.", show_default=False)
    ],
    out: Out = None,
    json: Json = False,
) -> None:
    """Print each published figure of a paper beside the computed one."""
    from gramian.reproduce import reproduce as run

    for paper in list(PAPERS) if name == "all" else [name]:
        folder = out / paper if out and name == "all" else out
        with _waiting(f"computing {paper}", quiet=json):
            report = run(paper)
        _finish(report, folder, json)


@contextmanager
def _in(file: Path) -> Iterator[None]:
    """Name the scenario where only the computation found its numbers to be wrong."""
    try:
        yield
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{file}: {error}") from error


def _waiting(what: str, *, quiet: bool) -> Status:
    return Console(stderr=True, quiet=quiet).status(what)


def _finish(report: Report, out: Path | None, json: bool) -> None:
    written = report.write(out) if out else ()
    if json:
        sys.stdout.write(report.to_json())
        return
    console = Console()
    report.show(console)
    if written:
        console.print()
        console.print("   ".join(str(path) for path in written), soft_wrap=True, highlight=False)


def main() -> None:
    """Run the command: exit status 0, 1 on bad input, 2 on wrong usage, 130 on Ctrl-C."""
    run: Callable[[], None] = app
    try:
        run()
    except GramianError as error:
        Console(stderr=True, soft_wrap=True).print(
            f"[bold red]error:[/] {_plain(str(error))}", highlight=False
        )
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


def _plain(text: str) -> str:
    from rich.markup import escape

    return escape(text)
