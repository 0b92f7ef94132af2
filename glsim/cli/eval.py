"""``glsim eval``: score denoisers on a data set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, cast, get_args

import typer

from glsim.cli.common import (
    MORE,
    WorkersOption,
    check_outputs,
    console,
    print_message,
    print_written,
)
from glsim.cli.figures import figures_wanted
from glsim.cli.progress import scoring_progress
from glsim.errors import ConfigError, DatasetError, DenoiserError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from glsim.eval.paper.runs import TrainedRun
    from glsim.eval.scoring.blocks import ScoringJob
    from glsim.eval.scoring.run import Evaluation

EXAMPLES = """
[bold]Examples[/bold]

glsim eval data -d median -d quadric:sigma_px=2.5,cleanup=5 -o scores

glsim eval data --tune-filters -o scores     the classical filters, tuned on the validation split

glsim eval data -d noisy -d mine@my_module:my_function -d run/best.pt

glsim eval data --runs runs              all networks in runs/*/

glsim eval data -d face --truth expected  needs generate --layers clean,expected,noisy

glsim eval folder_of_pairs -d median     *_clean.png and *_noisy.png from any source

glsim eval --list

Repeat the same command to resume an interrupted run. Real frames: glsim eval-real. The paper's
tables: glsim paper tables.
"""

DatasetArgument = Annotated[
    Path,
    typer.Argument(help="A data set (folder or URL), or a folder of *_clean.png and *_noisy.png."),
]
DenoisersOption = Annotated[
    list[str] | None,
    typer.Option(
        "--denoiser",
        "-d",
        metavar="[LABEL@]NAME[:KEY=VALUE,...]",
        help="A shipped denoiser (glsim eval --list), module:function, or a checkpoint. "
        "Repeatable.",
    ),
]
SplitOption = Annotated[str, typer.Option(help="Split to score: train, val or test.")]
OutOption = Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")]
TruthOption = Annotated[
    str,
    typer.Option(
        help="What predictions are compared with: clean, or expected (clean with the sensor's "
        "systematic error, which a denoiser leaves)."
    ),
]
ProtocolOption = Annotated[
    str | None,
    typer.Option(
        help="Where depth is counted from: depth (as measured) or paper (the nearest point of "
        "each frame at 1 mm). Default: as the files are stored."
    ),
]
RunsOption = Annotated[
    Path | None, typer.Option(help="Score the networks that glsim train wrote to RUNS/*/.")
]
TuneFiltersOption = Annotated[
    bool,
    typer.Option(
        "--tune-filters", help="Add the classical filters, tuned on the validation split."
    ),
]
InputOption = Annotated[
    bool,
    typer.Option(help="Score the noisy input too, as the first row.", rich_help_panel=MORE),
]
CompositesOption = Annotated[
    bool,
    typer.Option(
        "--composites",
        help="Show every composite of a network in tables and figures, not 'measured' alone; "
        "rows.csv and table.csv have all.",
        rich_help_panel=MORE,
    ),
]
BaselinesOption = Annotated[
    bool, typer.Option(help="Score trivial baselines too.", rich_help_panel=MORE)
]
FiguresOption = Annotated[
    bool, typer.Option(help="Draw figures and report.html.", rich_help_panel=MORE)
]
FocalOption = Annotated[
    float | None,
    typer.Option(
        min=1,
        help="Focal length of plain depth files, pixels. Default: the Kinect V2's.",
        rich_help_panel=MORE,
    ),
]
RoundedOption = Annotated[
    float | None,
    typer.Option(
        "--rounded-mm",
        min=0.01,
        max=10,
        help="Also score each map rounded to this step, mm, as files of glsim denoise are.",
        rich_help_panel=MORE,
    ),
]
DeviceOption = Annotated[
    Path | None,
    typer.Option(
        help="Sensor file of glsim fit: its fixed pattern and wiggling are subtracted from the "
        "input of all denoisers.",
        rich_help_panel=MORE,
    ),
]


def _print_list(asked: bool) -> None:
    if not asked:
        return
    from glsim.denoise import denoiser_names, describe_denoiser

    for name in denoiser_names():
        help, parameters = describe_denoiser(name)
        typer.echo(f"{name}: {help}")
        for parameter, (default, text) in parameters.items():
            value = "" if default is None else f"={default:g}"
            typer.echo(f"    {parameter}{value}  {text}")
    raise typer.Exit


def evaluate(
    dataset: DatasetArgument,
    denoiser: DenoisersOption = None,
    split: SplitOption = "test",
    out: OutOption = Path("scores"),
    truth: TruthOption = "clean",
    protocol: ProtocolOption = None,
    runs: RunsOption = None,
    tune_filters: TuneFiltersOption = False,
    noisy_input: InputOption = True,
    composites: CompositesOption = False,
    baselines: BaselinesOption = True,
    figures: FiguresOption = True,
    workers: WorkersOption = "auto",
    focal_px: FocalOption = None,
    device: DeviceOption = None,
    rounded_mm: RoundedOption = None,
    _list_denoisers: Annotated[
        bool,
        typer.Option(
            "--list",
            callback=_print_list,
            is_eager=True,
            help="Print the shipped denoisers and exit.",
        ),
    ] = False,
) -> None:
    """Score denoisers; write rows.csv, table.md, table.csv, table.tex and report.html with figures.

    Maps are scored unrounded, as denoisers return them.

    Frames that cannot be scored are reported and skipped; the exit status is then 1. Without
    --denoiser the paper's filters are scored. Nothing is trained.
    """
    score_denoisers(
        dataset, denoiser or [], out, split=split, truth=truth, protocol=protocol, runs=runs,
        tune_filters=tune_filters, baselines=baselines, figures=figures, workers=workers,
        focal_px=focal_px, device=device, noisy_input=noisy_input, composites=composites,
        rounded_mm=rounded_mm,
    )  # fmt: skip


def score_denoisers(
    dataset: Path,
    denoisers: Sequence[str],
    out: Path,
    *,
    split: str,
    truth: str,
    protocol: str | None,
    runs: Path | None,
    tune_filters: bool,
    baselines: bool,
    figures: bool,
    workers: str,
    focal_px: float | None = None,
    device: Path | None = None,
    noisy_input: bool = True,
    composites: bool = False,
    rounded_mm: float | None = None,
    tables: Sequence[int] = (),
) -> None:
    """Score denoisers and write the results; the options of ``glsim eval`` say what each means.

    Args:
        denoisers: specifications; the paper's filters are added where there are none, or a table.
        tables: numbers of the paper's tables that are written beside ours.

    Raises:
        ConfigError: an option is wrong.
        DatasetError: a frame could not be scored; the results of the others are written.
        DenoiserError: a checkpoint in ``runs`` was skipped; likewise.
    """
    from glsim.denoise import PAPER_FILTERS
    from glsim.depth_protocol import check_protocol
    from glsim.eval.scoring.blocks import ScoringJob
    from glsim.eval.scoring.pairs import TruthLayer
    from glsim.eval.scoring.run import evaluate as run
    from glsim.worker_processes import worker_count

    networks = _find_networks(tables, runs)
    specs = list(denoisers)
    if tables or not specs:
        specs = [*PAPER_FILTERS, *(spec for spec in specs if spec not in PAPER_FILTERS)]
    specs += [network.spec for network in networks.trained]
    unfiltered = PAPER_FILTERS[0]
    if noisy_input and unfiltered not in specs:
        specs = [unfiltered, *specs]
    count = worker_count(workers)
    check_outputs(out / "table.md")
    if truth not in get_args(TruthLayer):
        raise ConfigError(f"--truth {truth}: {did_you_mean(truth, get_args(TruthLayer))}")
    figures = figures_wanted(figures)
    job = ScoringJob(
        dataset,
        split,
        tuple(specs),
        focal_px,
        truth=cast(TruthLayer, truth),
        device=device,
        protocol=check_protocol(protocol),
        rounded_mm=rounded_mm or 0.0,
    )
    if tune_filters:
        job = _add_tuned_filters(job, out, count)
    with scoring_progress("scoring") as progress:
        evaluation = run(job, out, workers=count, baselines=baselines, progress=progress)
    _write_results(evaluation, job, out, tables, networks, figures, composites)
    for text in evaluation.first_bad:
        console.print(f"bad {text}", style="yellow")
    if evaluation.bad:
        raise DatasetError(
            f"{evaluation.bad} of {evaluation.frames} frames could not be scored, see "
            f"{out / 'bad.csv'}; the tables contain the others"
        )
    if networks.refused:
        raise DenoiserError(
            f"{len(networks.refused)} of the checkpoints in {runs} were skipped, the first: "
            f"{networks.refused[0]}"
        )


class _Networks(NamedTuple):
    trained: list[TrainedRun]
    refused: list[str]


def _find_networks(tables: Sequence[int], runs: Path | None) -> _Networks:
    """Find the trained networks for the tables; all of them if no table asks for networks.

    Raises ConfigError for an unknown table, or one of networks without --runs.
    """
    from glsim.eval.paper.network_tables import PAPER_ROWS
    from glsim.eval.paper.runs import find_trained_runs

    for table in tables:
        if table not in (1, *PAPER_ROWS):
            raise ConfigError(f"--table {table}: there are 1 (filters), 2 and 3 (networks)")
        if table in PAPER_ROWS and runs is None:
            raise ConfigError(f"--table {table}: give --runs, the folder of trained networks")
    if runs is None:
        return _Networks([], [])
    trained, refused = find_trained_runs(runs)
    for why in refused:
        console.print(f"skipped {why}", style="yellow")
    rows = {row for table in tables for row in PAPER_ROWS.get(table, ())}
    wanted = [run for run in trained if not rows or run.row is None or run.row in rows]
    return _Networks(wanted, refused)


def _add_tuned_filters(job: ScoringJob, out: Path, count: int) -> ScoringJob:
    """Tune the classical filters on the validation split and add them to the job."""
    from dataclasses import replace

    from glsim.denoise import GRIDS
    from glsim.eval.scoring.grid_search import tune_filters

    if job.split == "val":
        raise ConfigError("--tune-filters: settings tuned on val must be scored on another split")
    held_out = replace(job, split="val", rounded_mm=0.0)
    if held_out.frames().identity == job.frames().identity:
        raise ConfigError(
            f"--tune-filters: {job.dataset} has no splits: there is no validation split"
        )
    with scoring_progress("tuning") as progress:
        tuned = tune_filters(held_out, list(GRIDS), out, workers=count, progress=progress)
    specs = [spec for item in tuned for spec in (item.plain, item.cleaned)]
    for item in tuned:
        print_message(f"tuned {item.plain} and {item.cleaned.split(',')[-1]}")
    return replace(job, denoisers=tuple(dict.fromkeys([*job.denoisers, *specs])))


def _write_results(
    evaluation: Evaluation,
    job: ScoringJob,
    out: Path,
    tables: Sequence[int],
    networks: _Networks,
    figures: bool,
    composites: bool,
) -> None:
    """Write the tables and, if wanted, the figures and report.html into a folder."""
    from dataclasses import replace

    from glsim.dataset import open_dataset
    from glsim.dataset.disk_format import HEADER
    from glsim.eval.paper.data_note import data_note
    from glsim.eval.paper.filter_table import filter_table
    from glsim.eval.paper.network_tables import network_table
    from glsim.eval.paper.runs import group_by_network
    from glsim.eval.report.bias_table import write_bias_csv
    from glsim.eval.report.tables import (
        table_latex,
        table_markdown,
        write_table_csv,
    )
    from glsim.files.atomic import write_atomic

    table = evaluation.summary.compared()
    heading = f"{job.dataset.name}, {job.split}"
    heading += f", protocol {evaluation.protocol}"
    if job.truth != "clean":
        heading += f", compared with the {job.truth} depth"
    pages = {
        which: filter_table(evaluation, table)
        if which == 1
        else network_table(which, evaluation, table, *networks)
        for which in tables
    }
    if pages and (job.dataset / HEADER).is_file():
        note = data_note(open_dataset(job.dataset))
        for page in pages.values():
            page.parts.insert(1, note)
    summary = evaluation.summary if composites else evaluation.summary.one_composite()
    shown = replace(evaluation, summary=summary)
    shown_table = {method: table[method] for method in summary.methods}
    texts = {
        "table.md": table_markdown(shown, shown_table, heading),
        "table.tex": table_latex(shown_table),
    }
    texts |= {f"paper_table_{which}.md": page.markdown() for which, page in pages.items()}
    for name, text in texts.items():
        write_atomic(text.encode(), out / name)
    write_table_csv(out / "table.csv", table)
    if evaluation.baselines.methods:
        write_table_csv(out / "baselines.csv", evaluation.baselines.compared())
    write_bias_csv(out / "bias_by_distance.csv", evaluation.summary)
    paths = [out / name for name in ("rows.csv", "table.csv", "bias_by_distance.csv")]
    paths += [out / name for name in texts]
    if figures:
        from glsim.eval.report.html_report import write_report

        # The figures show one seed of each network.
        others = {
            one.spec for group in group_by_network(networks.trained) for one in group.members[1:]
        }
        drawn = [spec for spec in job.denoisers if spec not in others]
        report = write_report(shown, shown_table, job, out, heading, list(pages.values()), drawn)
        paths.append(report)
    print_written(paths)
