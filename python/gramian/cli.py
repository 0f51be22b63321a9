"""The command `gramian`."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.resources import as_file, files
from importlib.util import find_spec
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.status import Status

from gramian._files import write_whole
from gramian._text import visible
from gramian.exceptions import GramianError, InputError, ScenarioError, StorageError
from gramian.report import Report
from gramian.reproduce import PAPERS

if TYPE_CHECKING:
    from gramian.scenario import Scenario

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
Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="A scenario (FILE.toml), files of tracks and measurements, or a graph (.g2o).",
        show_default=False,
    ),
]
_FROM_FILES = "For files without a scenario"
Observer = Annotated[
    str | None,
    typer.Option(help="The track of the observer.", rich_help_panel=_FROM_FILES),
]
Target = Annotated[
    str | None, typer.Option(help="The track of the target.", rich_help_panel=_FROM_FILES)
]
Sensor = Annotated[
    str | None,
    typer.Option(help="The sensor whose bearings are used.", rich_help_panel=_FROM_FILES),
]
SigmaDeg = Annotated[
    float | None,
    typer.Option(help="Standard deviation of the bearings, degrees.", rich_help_panel=_FROM_FILES),
]
Start = Annotated[
    str | None,
    typer.Option(
        help="Start of the window: seconds as the files count them, a date, or +SECONDS from "
        "the first instant that is shared.",
        rich_help_panel=_FROM_FILES,
    ),
]
Duration = Annotated[
    float | None, typer.Option(help="Seconds of the window.", rich_help_panel=_FROM_FILES)
]
Step = Annotated[
    float | None,
    typer.Option(help="Seconds from one bearing to the next.", rich_help_panel=_FROM_FILES),
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
def analyze(
    file: Files,
    observer: Observer = None,
    target: Target = None,
    sensor: Sensor = None,
    sigma_deg: SigmaDeg = None,
    start: Start = None,
    duration: Duration = None,
    step: Step = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Say what the measurements of a scenario, or the edges of a g2o graph, determine."""
    if [path.suffix.lower() for path in file] == [".g2o"]:
        from gramian.io.graph_report import report as graph_report

        with Console(stderr=True, quiet=json).status(f"analysing {file[0].name}"):
            report = graph_report(file[0])
        _finish(report, out, json)
        return
    scenario = _scenario(file, (observer, target, sensor, sigma_deg, start, duration, step))
    with _in(scenario.path):
        report = scenario.analyze()
    _finish(report, out, json)


@app.command()
def localize(
    file: Files,
    observer: Observer = None,
    target: Target = None,
    sensor: Sensor = None,
    sigma_deg: SigmaDeg = None,
    start: Start = None,
    duration: Duration = None,
    step: Step = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Estimate from the recorded measurements of a scenario."""
    scenario = _scenario(file, (observer, target, sensor, sigma_deg, start, duration, step))
    with _in(scenario.path):
        report = scenario.localize()
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
            Console(emoji=False, stderr=True, soft_wrap=True).print(_plain(note), highlight=False)
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

    console = Console(emoji=False)
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
    lacking = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    for scenario in scenarios:
        console.rule(f"gramian analyze {scenario}", align="left", style="dim")
        _finish(load(scenario).analyze(), None if lacking else out / scenario.stem, json=False)
    if lacking:
        console.print(
            f"\nReports with pictures need {' and '.join(lacking)}: pip install 'gramian[report]'",
            highlight=False,
            markup=False,
        )
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
        with _spinner(f"computing {paper}", quiet=json):
            report = run(paper)
        _finish(report, folder, json)


@app.command("import")
def import_(
    file: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Files of tracks and measurements.", show_default=False
        ),
    ],
    observer: Observer = None,
    target: Target = None,
    sensor: Sensor = None,
    sigma_deg: SigmaDeg = None,
    start: Start = None,
    duration: Duration = None,
    step: Step = None,
    scenario: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Write a scenario here.", show_default=False),
    ] = None,
) -> None:
    """Show what is in files of tracks and measurements, and write a scenario to start from."""
    from gramian.io import read
    from gramian.scenario import Choices, draft

    recording = read(*file)
    Console(emoji=False, soft_wrap=True).print(_plain(recording.summary()), highlight=False)
    if scenario is None:
        return
    if scenario.exists():
        raise StorageError(f"{scenario}: is there already; choose another name or remove it")
    choices = Choices(observer, target, sensor, sigma_deg, start, duration, step)
    text = draft(recording, choices, scenario.parent)
    try:
        write_whole(scenario, text.encode())
    except OSError as error:
        raise StorageError(f"cannot write {scenario}: {error}") from error
    Console(emoji=False).print(f"\n{_plain(str(scenario))} written", highlight=False)


@app.command()
def schema(
    model: Annotated[str, typer.Argument(help="A model of scenario files.", show_default=False)],
) -> None:
    """Print the JSON Schema of a model's scenario files, for editors."""
    from gramian.scenario import schema as of

    sys.stdout.write(dumps(of(model), indent=2) + "\n")


def _scenario(
    paths: Sequence[Path],
    choices: tuple[
        str | None,
        str | None,
        str | None,
        float | None,
        str | None,
        float | None,
        float | None,
    ],
) -> Scenario:
    from gramian.scenario import Choices, from_files, load

    chosen = Choices(*choices)
    scenarios = [path for path in paths if path.suffix.lower() == ".toml"]
    if not scenarios:
        return from_files(paths, chosen)
    if len(paths) > 1:
        raise InputError(f"{scenarios[0]}: a scenario stands alone, without other files")
    if chosen.given:
        option = chosen.given[0].replace("_", "-")
        raise InputError(f"{scenarios[0]}: has its own settings: --{option} is for other files")
    return load(scenarios[0])


@contextmanager
def _in(file: Path) -> Iterator[None]:
    """Name the scenario where only the computation found its numbers to be wrong."""
    try:
        yield
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{file}: {error}") from error


def _spinner(what: str, *, quiet: bool) -> Status:
    return Console(emoji=False, stderr=True, quiet=quiet).status(what)


def _finish(report: Report, out: Path | None, json: bool) -> None:
    written = report.write(out) if out else ()
    if json:
        sys.stdout.write(report.to_json())
        return
    console = Console(emoji=False)
    report.show(console)
    if written:
        console.print()
        console.print("   ".join(str(path) for path in written), soft_wrap=True, highlight=False)


def main() -> None:
    """Run the command: exit status 0, 1 on bad input, 2 on wrong usage, 130 on Ctrl-C."""
    run: Callable[[], None] = app
    try:
        run()
        sys.stdout.flush()
    except (GramianError, MemoryError, RecursionError) as error:
        _fail(str(error) or type(error).__name__)
    except BrokenPipeError:
        # Who read the output has gone: nothing is left to say, and nobody to say it to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (OSError, ValueError) as error:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _fail(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


def _fail(message: str) -> NoReturn:
    Console(emoji=False, stderr=True, soft_wrap=True).print(
        f"[bold red]error:[/] {_plain(message)}", highlight=False
    )
    sys.exit(1)


def _plain(text: str) -> str:
    from rich.markup import escape

    return escape(visible(text))
