"""The command ``diffthrust campaign``: a task over every spec of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    CHECK_FAILED,
    JsonPath,
    TrustOption,
    effect_names,
    session,
    show,
    written,
)


def campaign_command(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="A folder, searched recursively.")
    ],
    task: Annotated[
        Literal["fit", "diagnose", "sample"],
        typer.Option("--task", help="What to do with each spec."),
    ] = "fit",
    output: Annotated[
        Path, typer.Option("--output", metavar="OUT", help="Where the results go.")
    ] = Path("campaign_output"),
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", metavar="N", min=1, help="Processes; as many as processors by default."
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", metavar="ADDRESS", help="The scheduler of a Dask cluster."),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", metavar="S", help="Kill a task after S seconds.")
    ] = None,
    candidates: Annotated[
        str | None,
        typer.Option("--candidates", metavar="A,B,...", help="Effects that a diagnosis tries."),
    ] = None,
    method: Annotated[str | None, typer.Option("--method", help="Sampler: emcee or nuts.")] = None,
    draws: Annotated[
        int | None, typer.Option("--draws", metavar="N", help="Draws of a sampler.")
    ] = None,
    warmup: Annotated[
        int | None, typer.Option("--warmup", metavar="N", help="Warmup steps.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", help="Seed of a sampler.")
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Write a page into the folder of each spec.")
    ] = False,
    trust: TrustOption = None,
    json: JsonPath = None,
) -> None:
    """Fit, diagnose or sample every spec below DIR in parallel; a rerun does the remaining work.

    Exit status 1 where a spec has no result: it failed, ran out of time, or lost its worker.
    """
    with session() as progress:
        from diffthrust.many import campaign

        finished = campaign(
            directory,
            task=task,
            output=output,
            executor=cluster,
            jobs=jobs,
            time_limit=time_limit,
            report=report,
            trust=trust or (),
            progress=progress,
            candidates=effect_names(candidates),
            method=method,
            draws=draws,
            warmup=warmup,
            seed=seed,
        )
        if json:
            write_json(json, finished.to_json())
    show(finished)
    written(finished.path, json)
    if not finished.ok:
        raise typer.Exit(CHECK_FAILED)
