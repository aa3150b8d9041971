"""The command ``diffthrust sample``: draw from the posterior, and report convergence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    JsonPath,
    ReportPath,
    SpecPath,
    TrustOption,
    file_option,
    session,
    show,
    written,
)


def sample_command(
    spec: SpecPath,
    method: Annotated[
        Literal["emcee", "nuts"],
        typer.Option("--method", help="emcee: an ensemble of walkers; nuts: uses the gradient."),
    ] = "emcee",
    draws: Annotated[
        int, typer.Option("--draws", metavar="N", min=10, help="Draws of each walker or chain.")
    ] = 2000,
    warmup: Annotated[
        int, typer.Option("--warmup", metavar="N", min=0, help="Warmup steps, not counted.")
    ] = 1000,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Equal seeds give equal draws.")
    ] = 0,
    file: Annotated[
        Path | None,
        file_option(
            "--file",
            "CHAIN.h5",
            "Keep the chain in this file (emcee); a killed run resumes from it.",
            ".hdf5",
        ),
    ] = None,
    walkers: Annotated[
        int | None, typer.Option("--walkers", metavar="N", help="Walkers of emcee, an even number.")
    ] = None,
    chains: Annotated[int, typer.Option("--chains", metavar="N", help="Chains of nuts.")] = 4,
    json: JsonPath = None,
    report: ReportPath = None,
    save: Annotated[
        Path | None,
        file_option(
            "--save",
            "FILE.nc",
            "Save the posterior as netCDF, for ArviZ; in Python dft.load(FILE) reads it.",
        ),
    ] = None,
    trust: TrustOption = None,
) -> None:
    """Draw from the posterior of each parameter, and check convergence."""
    with session() as progress:
        from diffthrust._support.progress import reporter, subtask
        from diffthrust.specs._spec import load_spec
        from diffthrust.uncertainty._sampling.arviz import write_posterior
        from diffthrust.uncertainty._sampling.page import sample_report, write_posterior_page
        from diffthrust.uncertainty._sampling.sample import check_sampling, sample
        from diffthrust.uncertainty._sampling.summary import sampled

        check_sampling(method, draws, warmup, chains, seed, walkers, file)  # before the fit
        loaded = load_spec(spec, trust=trust or ())
        train, unseen = loaded.train_logs(), loaded.holdout_logs()
        notify = reporter(progress)
        fit = loaded.fit(progress=subtask(notify, 0.0, 0.2), train=train, holdout=unseen)
        post = sample(
            fit,
            train,
            method=method,
            draws=draws,
            warmup=warmup,
            walkers=walkers,
            chains=chains,
            seed=seed,
            file=file,
            progress=subtask(notify, 0.2, 1.0),
        )
        # Before the summary: its predictions take a while, and an interrupt must not lose the
        # chain.
        if save:
            write_posterior(post, save)
        posterior = sampled(post, fit, train, unseen, seed=seed)
        if json:
            write_json(json, posterior.to_json())
        if report:
            write_posterior_page(
                posterior, report, title=f"Posterior: {loaded.name}", spec=loaded.text
            )
    show(sample_report(posterior))
    written(file, json, report, save)
