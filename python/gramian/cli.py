"""The command `gramian`."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from importlib.resources import as_file, files
from importlib.util import find_spec
from json import dumps, loads
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.status import Status

from gramian._files import files_up_to, write_whole
from gramian._registry import REGISTRY
from gramian._text import brief, visible
from gramian.exceptions import (
    GramianError,
    InputError,
    ScenarioError,
    StorageError,
    UnobservableError,
)
from gramian.report import Report
from gramian.reproduce import PAPERS

if TYPE_CHECKING:
    from gramian.scenario import Choices, Scenario

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
        metavar="FILE",
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
Json = Annotated[
    bool, typer.Option("--json", metavar="", help="Print the result as JSON and nothing else.")
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        metavar="",
        help="Exit with 3 where the answer is no: not determined, a misfit, no agreement.",
    ),
]
Dates = Annotated[
    str | None,
    typer.Option(
        metavar='"day first"|"month first"',
        help="The order in dates such as 01/05/2026.",
        rich_help_panel=_FROM_FILES,
    ),
]
Named = Annotated[
    list[str],
    typer.Option(
        "--column",
        metavar="WHAT=HEADING",
        help="What a column of a table holds, where its heading does not say it (time=Zeit): "
        "once for each.",
        show_default=False,
        rich_help_panel=_FROM_FILES,
    ),
]
SizeLimit = Annotated[
    int,
    typer.Option(metavar="MIB", min=1, help="Files beyond this size are refused, MiB."),
]

#: Exit status of an answer that is no, with --strict.
_NO = 3


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
            "--version",
            metavar="",
            callback=_version,
            is_eager=True,
            help="Say which version this is.",
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
    dates: Dates = None,
    column: Named = [],  # noqa: B006  (typer copies it)
    size_limit: SizeLimit = 512,
    out: Out = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Say what the measurements of a scenario, or the edges of a g2o graph, determine."""
    from gramian.scenario import Choices

    chosen = Choices(
        observer, target, sensor, sigma_deg, start, duration, step, dates, _columns(column)
    )

    def ask() -> Report:
        if [path.suffix.lower() for path in file] == [".g2o"]:
            from gramian.io.graph_report import report as graph_report

            return replace(graph_report(file[0]), inputs=tuple(file))
        scenario = _scenario(file, chosen)
        with _in(scenario.path):
            return _of(scenario.analyze(), file, scenario)

    with files_up_to(size_limit << 20):
        _answer(ask, out, json, strict, f"working on {file[0].name}")


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
    dates: Dates = None,
    column: Named = [],  # noqa: B006  (typer copies it)
    size_limit: SizeLimit = 512,
    out: Out = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Estimate from the recorded measurements of a scenario."""
    from gramian.scenario import Choices

    chosen = Choices(
        observer, target, sensor, sigma_deg, start, duration, step, dates, _columns(column)
    )

    def ask() -> Report:
        scenario = _scenario(file, chosen)
        with _in(scenario.path):
            return _of(scenario.localize(), file, scenario)

    with files_up_to(size_limit << 20):
        _answer(ask, out, json, strict, f"working on {file[0].name}")


@app.command()
def explore(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE.toml]",
            help="The scenario to begin with: of tracks, bearings, dipole or registration.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PAGE.html",
            help="Write the page here instead of opening it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Open the explorer in a browser: drag a scenario and see what changes."""
    from gramian.explorer import opened, page

    text = page(None if file is None else opened(file))
    if out is not None:
        try:
            write_whole(out, text.encode())
        except OSError as error:
            raise StorageError(f"{out}: cannot be written: {error}") from error
        sys.stdout.write(f"{out}\n")
        return
    import tempfile
    import webbrowser

    # The browser reads it after the command has ended: it stays in the temporary folder.
    with tempfile.NamedTemporaryFile(
        "w", prefix="gramian-explorer-", suffix=".html", delete=False, encoding="utf-8"
    ) as place:
        place.write(text)
    if not webbrowser.open(Path(place.name).as_uri()):
        raise GramianError(f"no browser was found: open {place.name} in one")


@app.command()
def plan(file: File, out: Out = None, json: Json = False, strict: Strict = False) -> None:
    """Choose the observer's path of a scenario so as to know the most."""
    from gramian.scenario import load

    def ask() -> Report:
        scenario = load(file)
        what = "searching for a path"
        with _in(file), _spinner(what) as shown:

            def tell(done: int, pieces: int, best: float) -> None:
                found = f", best so far {brief(best)}" if isfinite(best) else ""
                shown.update(_plain(f"{what}: {done} of {pieces} pieces{found}"))

            return _of(scenario.plan(tell), [file], scenario)

    _answer(ask, out, json, strict, doing=None)


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
    strict: Strict = False,
) -> None:
    """Estimate in many simulated trials and set the errors beside the bound."""
    from gramian.scenario import load

    def ask() -> Report:
        scenario = load(file)
        with _in(file):
            report = scenario.simulate(trials, seed, resume=resume, progress=not json)
        return _of(report, [file], scenario)

    # It has its own progress bar.
    _answer(ask, out, json, strict, doing=None)


@app.command()
def demo(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where the scenarios and reports go.")
    ] = Path("gramian-demo"),
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Analyse three ships that ship with the package: easy, hopeless, impossible."""
    from gramian.scenario import load

    console = Console(emoji=False, quiet=json)
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
    answers = _Answers(json, strict)
    for scenario in scenarios:
        loaded = load(scenario)
        with _spinner(f"analysing {scenario.stem}"):
            report = _of(loaded.analyze(), [scenario], loaded)
        console.rule(f"gramian analyze {scenario}", align="left", style="dim")
        answers.add(scenario.stem, report, out / scenario.stem)
    console.print("\nEdit a scenario and run its line again, or point one at your own tracks.")
    answers.close()


@app.command()
def reproduce(
    name: Annotated[
        str, typer.Argument(help=f"A paper ({', '.join(PAPERS)}), or all.", show_default=False)
    ],
    out: Out = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Print each published figure of a paper beside the computed one."""
    from gramian.reproduce import reproduce as run

    answers = _Answers(json, strict)
    for paper in list(PAPERS) if name == "all" else [name]:
        folder = out / paper if out and name == "all" else out
        answers.add(paper, _ask(partial(run, paper), f"computing {paper}"), folder)
    answers.close(one=name != "all")


@app.command("import")
def import_(
    file: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="Files of tracks and measurements.", show_default=False
        ),
    ],
    observer: Observer = None,
    target: Target = None,
    sensor: Sensor = None,
    sigma_deg: SigmaDeg = None,
    start: Start = None,
    duration: Duration = None,
    step: Step = None,
    dates: Dates = None,
    column: Named = [],  # noqa: B006  (typer copies it)
    pass_: Annotated[
        str | None, typer.Option("--pass", help="The pass in a table of a magnetic field.")
    ] = None,
    sensor_at: Annotated[
        list[str],
        typer.Option(
            metavar="X,Y,Z", help="Where a magnetometer is, m: once for each.", show_default=False
        ),
    ] = [],  # noqa: B006  (typer copies it)
    size_limit: SizeLimit = 512,
    scenario: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Write a scenario here.", show_default=False),
    ] = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Show what is in files of tracks and measurements, and write a scenario to start from."""
    from gramian.io import read
    from gramian.io.fields import field_table
    from gramian.io.fields import report as field_report
    from gramian.io.report import report as import_report
    from gramian.scenario import Choices, draft, draft_of_field

    if scenario is not None and scenario.exists():
        raise StorageError(f"{scenario}: is there already; choose another name or remove it")
    with files_up_to(size_limit << 20), _spinner("reading"):
        field = field_table(file[0]) if len(file) == 1 else None
        named = _columns(column)
        recording = None if field is not None else read(*file, columns=named, dates=dates)
    if scenario is not None:
        if field is not None:
            text = draft_of_field(field, pass_, [_place(at) for at in sensor_at], scenario.parent)
        elif recording is not None:
            choices = Choices(
                observer, target, sensor, sigma_deg, start, duration, step, dates, named
            )
            text = draft(recording, choices, scenario.parent)
        try:
            write_whole(scenario, text.encode())
        except OSError as error:
            raise StorageError(f"cannot write {scenario}: {error}") from error
    answers = _Answers(json, strict=False)
    if field is not None:
        answers.add("import", field_report(field), out)
    elif recording is not None:
        answers.add("import", import_report(recording), out)
    if scenario is not None and not json:
        # A path is copied whole.
        Console(emoji=False).print(
            f"\n{_plain(str(scenario))} written", soft_wrap=True, highlight=False
        )
    answers.close(one=True)


@app.command()
def schema(
    model: Annotated[
        str,
        typer.Argument(
            help=f"A model of scenario files ({', '.join(REGISTRY)}), or all.", show_default=False
        ),
    ],
    markdown: Annotated[
        bool, typer.Option("--markdown", metavar="", help="Print a page of every key instead.")
    ] = False,
    json: Annotated[
        bool,
        typer.Option("--json", metavar="", help="Print JSON: the default.", show_default=False),
    ] = True,
) -> None:
    """Print the JSON Schema of a model's scenario files, for editors; or a page of its keys."""
    from gramian.scenario import reference
    from gramian.scenario import schema as of

    sys.stdout.write(reference(model) if markdown else dumps(of(model), indent=2) + "\n")


def _columns(given: Sequence[str]) -> dict[str, str] | None:
    """Return what columns hold, given as WHAT=HEADING."""
    pairs = [text.partition("=") for text in given]
    for text, (what, _, heading) in zip(given, pairs, strict=True):
        if not what or not heading:
            raise InputError(f"--column {text}: must be what it holds and its heading: time=Zeit")
    return {what: heading for what, _, heading in pairs} or None


def _scenario(paths: Sequence[Path], chosen: Choices) -> Scenario:
    from gramian.scenario import from_files, load

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


def _place(text: str) -> tuple[float, float, float]:
    """Return a position that was given as X,Y,Z."""
    with suppress(ValueError):
        x, y, z = map(float, text.split(","))
        if isfinite(x + y + z):
            return x, y, z
    raise InputError(f"--sensor-at {text}: must be three numbers in metres, such as 0,0.5,0")


def _spinner(what: str) -> Status:
    # On a terminal only: rich shows nothing in a pipe.
    return Console(emoji=False, stderr=True).status(_plain(what))


def _of(report: Report, given: Sequence[Path], scenario: Scenario) -> Report:
    """Return a report that knows the files it answers for."""
    return replace(report, inputs=tuple(dict.fromkeys([*given, *scenario.inputs])))


def _ask(question: Callable[[], Report], doing: str | None) -> Report:
    """Return the answer to a question; that no answer exists is one too."""
    try:
        with _spinner(doing) if doing else nullcontext():
            return question()
    except UnobservableError as error:
        return Report(
            title="no answer",
            subtitle="",
            tone="bad",
            headline="UNOBSERVABLE",
            verdict=str(error),
            facts=[("changes no measurement", text) for text in error.null_combinations],
            data={"status": "unobservable", "null_combinations": list(error.null_combinations)},
        )
    except KeyboardInterrupt as stop:
        for note in getattr(stop, "__notes__", ["stopped"]):
            Console(emoji=False, stderr=True, soft_wrap=True).print(_plain(note), highlight=False)
        raise


def _answer(
    question: Callable[[], Report],
    out: Path | None,
    json: bool,
    strict: bool,
    doing: str | None = "working",
) -> None:
    answers = _Answers(json, strict)
    answers.add("", _ask(question, doing), out)
    answers.close(one=True)


class _Answers:
    """The answers of one command, printed as they come; as JSON all at its end."""

    def __init__(self, json: bool, strict: bool) -> None:
        self.json, self.strict = json, strict
        self.reports: dict[str, Report] = {}
        self.lacking: list[str] = []

    def add(self, name: str, report: Report, out: Path | None) -> None:
        """Write an answer to its folder, and print it."""
        written: tuple[Path, ...] = ()
        if out is not None:
            self.lacking = [one for one in ("matplotlib", "jinja2") if find_spec(one) is None]
            with _spinner("writing the report"):
                written = (report.write_data(out),) if self.lacking else report.write(out)
        self.reports[name] = report
        if self.json:
            return
        console = Console(emoji=False)
        report.show(console)
        if written:
            console.print()
            console.print("   ".join(map(str, written)), soft_wrap=True, highlight=False)

    def close(self, *, one: bool = False) -> None:
        """Print what belongs at the end, and leave with the status of the answers."""
        if self.json:
            texts = {name: report.to_json() for name, report in self.reports.items()}
            whole = {name: loads(text) for name, text in texts.items()}
            sys.stdout.write(*texts.values() if one else (dumps(whole, indent=2) + "\n",))
        if self.lacking:
            Console(emoji=False, stderr=True, soft_wrap=True).print(
                f"A page with pictures needs {' and '.join(self.lacking)}: "
                "pip install 'gramian[report]'",
                highlight=False,
                markup=False,
            )
        if self.strict and any(report.tone == "bad" for report in self.reports.values()):
            sys.stdout.flush()
            raise typer.Exit(_NO)


def main() -> None:
    """Run the command.

    Exit status 0: answered, 1: bad input, 2: wrong usage, 3: with --strict, an answer
    that is no; 130: stopped with Ctrl-C.
    """
    run: Callable[[], None] = app
    try:
        try:
            run()
        finally:
            # What cannot be written is an error of the command, not of the interpreter's end.
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
        sys.stderr.write("stopped\n")
        sys.exit(130)


def _fail(message: str) -> NoReturn:
    Console(emoji=False, stderr=True, soft_wrap=True).print(
        f"[bold red]error:[/] {_plain(message)}", highlight=False
    )
    sys.exit(1)


def _plain(text: str) -> str:
    from rich.markup import escape

    return escape(visible(text))
