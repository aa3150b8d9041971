"""The command ``diffthrust sample``: a posterior, how far it can be believed, and its report."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from diffthrust.cli._options import JsonPath, ReportPath, SpecPath, ends, show, written
from diffthrust.cli._session import session


class Method(StrEnum):
    """The samplers, by the names of the option."""

    emcee = "emcee"
    nuts = "nuts"


def sample(
    spec: SpecPath,
    method: Annotated[
        Method,
        typer.Option("--method", help="emcee: an ensemble of walkers; nuts: along the gradient."),
    ] = Method.emcee,
    draws: Annotated[
        int, typer.Option("--draws", metavar="N", min=10, help="Draws of each walker or chain.")
    ] = 2000,
    warmup: Annotated[
        int, typer.Option("--warmup", metavar="N", min=0, help="Steps before, not counted.")
    ] = 1000,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Equal seeds give equal draws.")
    ] = 0,
    file: Annotated[
        Path | None,
        typer.Option(
            "--file",
            metavar="CHAIN.h5",
            help="Keep the chain in this file (emcee); a run that was killed goes on from it.",
            callback=ends(".h5", ".hdf5"),
        ),
    ] = None,
    walkers: Annotated[
        int | None, typer.Option("--walkers", metavar="N", help="Walkers of emcee, an even number.")
    ] = None,
    chains: Annotated[int, typer.Option("--chains", metavar="N", help="Chains of nuts.")] = 4,
    json: JsonPath = None,
    report: ReportPath = None,
) -> None:
    """Draw from the posterior: what the logs say of each parameter, and how far to trust it."""
    with session() as progress:
        from diffthrust.specs._spec import load_spec
        from diffthrust.uncertainty._sampling.sample import check
        from diffthrust.uncertainty._sampling.sample import sample as run
        from diffthrust.uncertainty._sampling.summary import Sampled, sampled
        from diffthrust.uncertainty._sampling.tables import sample_table

        check(method.value, draws, warmup, chains, seed, walkers, file)  # before the fit
        loaded = load_spec(spec)
        train, unseen = loaded.train_logs(), loaded.holdout_logs()
        fit = loaded.fit(progress, train=train, holdout=unseen)
        post = run(
            fit,
            train,
            method=method.value,
            draws=draws,
            warmup=warmup,
            walkers=walkers,
            chains=chains,
            seed=seed,
            file=file,
            progress=progress,
        )
        found: Sampled = sampled(post, fit, train, unseen, seed=seed)
        if json:
            from diffthrust._support.files import write_json

            write_json(json, found.to_json())
        if report:
            _report(report, found, loaded)
        table = sample_table(found)
    show(table)
    written(file, json, report)


def _report(path: Path, found: Any, loaded: Any) -> None:
    from diffthrust.uncertainty._sampling.page import write_report

    write_report(found, path, title=f"Posterior: {loaded.name}", spec=loaded.text)
