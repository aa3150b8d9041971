"""The commands that take one spec: ``fit``, ``compare``, ``diagnose``, ``sample``, ``export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_json
from diffthrust.cli import _session as ui


def fit_command(
    spec: ui.SpecPath,
    json: ui.JsonPath = None,
    report: ui.ReportPath = None,
    save: ui.SavePath = None,
    trust: ui.TrustOption = None,
) -> None:
    """Estimate the free parameters of a model from logs, and test it on unseen logs."""
    with ui.session() as progress:
        from diffthrust.comparison._page import comparisons_of, write_comparison_page
        from diffthrust.specs._spec import load_spec

        loaded = load_spec(spec, trust=trust or ())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        if save:
            fit.save(save)
        ui.write_json_of(json, fit)
        if report:
            comparisons = comparisons_of(fit, train, holdout)
            write_comparison_page(
                report, title=loaded.name, spec=loaded.text, comparisons=comparisons, fit=fit
            )
    ui.show(fit)
    ui.written(json, report, save)


def compare_command(
    spec: ui.FittedPath,
    no_fit: ui.NoFitOption = False,
    json: ui.JsonPath = None,
    report: ui.ReportPath = None,
    figure: Annotated[
        Path | None, ui.figure_option("Draw the unseen logs, or all if none.")
    ] = None,
    trust: ui.TrustOption = None,
) -> None:
    """Compare a model with its logs, run by run, after a fit or without one."""
    with ui.session() as progress:
        from diffthrust.comparison._compare import comparison_report
        from diffthrust.comparison._page import comparisons_of, write_comparison_page
        from diffthrust.saved._load import fitted_spec

        loaded, fit = fitted_spec(spec, trust or ())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        if no_fit:
            fit = None
        elif fit is None:
            fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        comparisons = comparisons_of(fit or loaded.model, train, holdout)
        if json:
            parts = {name.split()[0]: c.to_json() for name, c in comparisons.items()}
            # The two comparisons share model and effects: JSON states them once, and the errors per
            # part.
            head = {k: next(iter(parts.values()))[k] for k in ("schema", "model", "effects")}
            short = {k: {n: v[n] for n in ("errors", "runs")} for k, v in parts.items()}
            short = {"train": short["training"], "holdout": short.get("unseen")}
            status = fit.status.value if fit else None
            write_json(json, {**head, "status": status, **short})
        if report:
            write_comparison_page(
                report, title=loaded.name, spec=loaded.text, comparisons=comparisons, fit=fit
            )
        ui.write_figure(figure, list(comparisons.values())[-1].plot)
    if fit:
        ui.show(f"Status: {fit.status.value}. {fit.message}")
    for name, comparison in comparisons.items():
        ui.show(comparison_report(comparison, name))
    ui.written(json, report, figure)


def diagnose_command(
    spec: ui.FittedPath,
    candidates: Annotated[
        str | None,
        Option(
            metavar="A,B,...",
            help="Effects to try, also script.py:Class, and fixed constants of the model; "
            "'all', the default, is the catalogue and every constant.",
        ),
    ] = None,
    json: ui.JsonPath = None,
    report: ui.ReportPath = None,
    save: ui.SavePath = None,
    brief: Annotated[
        bool, Option("--brief", help="Print the answer alone, and propose no test.")
    ] = False,
    trust: ui.TrustOption = None,
) -> None:
    """Find what a model lacks: where it fails, which effect is missing, what is undecided."""
    with ui.session() as progress:
        from diffthrust._support.results import report_of
        from diffthrust.saved._load import fitted_spec

        loaded, fit = fitted_spec(spec, trust or ())
        names = ui.effect_names(candidates)
        diagnosis = loaded.diagnose(
            progress=progress, candidates=names, fit=fit, experiment=not brief
        )
        if save:
            diagnosis.save(save)
        ui.write_json_of(json, diagnosis)
        if not brief:  # its tables take a while, after all that is sought is found
            progress("how much is left to explain", 1.0)
        answer = diagnosis.summary if brief else report_of(diagnosis)
        if report:
            progress("writing the page", 1.0)
            diagnosis.save(report, title=f"Diagnosis: {loaded.name}", spec=loaded.text)
    ui.show(answer)
    ui.written(json, report, save)


def sample_command(
    spec: ui.SpecPath,
    method: Annotated[
        Literal["emcee", "nuts"],
        Option(help="emcee: an ensemble of walkers; nuts: uses the gradient."),
    ] = "emcee",
    draws: Annotated[
        int, Option(metavar="N", min=10, help="Draws of each walker or chain.")
    ] = 2000,
    warmup: Annotated[int, Option(metavar="N", min=0, help="Warmup steps, not counted.")] = 1000,
    seed: Annotated[int, Option(metavar="N", min=0, help="Equal seeds give equal draws.")] = 0,
    file: Annotated[
        Path | None,
        ui.file_option(
            "CHAIN.h5",
            "Keep the chain in this file (emcee); a killed run resumes from it.",
            ".hdf5",
        ),
    ] = None,
    walkers: Annotated[
        int | None, Option(metavar="N", help="Walkers of emcee, an even number.")
    ] = None,
    chains: Annotated[int, Option(metavar="N", help="Chains of nuts.")] = 4,
    json: ui.JsonPath = None,
    report: ui.ReportPath = None,
    save: Annotated[
        Path | None,
        ui.file_option(
            "FILE.nc", "Save the posterior as netCDF, for ArviZ; in Python dft.load(FILE) reads it."
        ),
    ] = None,
    trust: ui.TrustOption = None,
) -> None:
    """Draw from the posterior of each parameter, and check convergence."""
    with ui.session() as progress:
        from diffthrust._support.progress import reporter, subtask
        from diffthrust.specs._spec import load_spec
        from diffthrust.uncertainty._sampling.arviz import write_posterior
        from diffthrust.uncertainty._sampling.sample import check_sampling, sample
        from diffthrust.uncertainty._sampling.summary import (
            sample_report,
            sampled,
            write_posterior_page,
        )

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
        ui.write_json_of(json, posterior)
        if report:
            write_posterior_page(
                posterior, report, title=f"Posterior: {loaded.name}", spec=loaded.text
            )
    ui.show(sample_report(posterior))
    ui.written(file, json, report, save)


def export_command(
    fit: Annotated[
        Path,
        Argument(
            metavar="FIT", help="A saved fit (.json), or a spec file or its folder, fitted first."
        ),
    ],
    to: Annotated[
        Literal["python", "c", "lut", "gz", "uuv", "stonefish"],
        Option(
            help="A module of plain Python, a C99 header, a steady-state table of force and "
            "command, or a thruster for gz-sim, uuv_simulator or Stonefish."
        ),
    ],
    output: Annotated[
        Path | None, Option(metavar="PATH", help="The file to write; without it, standard output.")
    ] = None,
    limits: Annotated[
        tuple[float, float] | None,
        Option(
            metavar="LOW HIGH",
            help="Lowest and highest command, in the unit of the logs; as in the logs by default.",
        ),
    ] = None,
    trust: ui.TrustOption = None,
) -> None:
    """Export a fit to firmware, a thrust allocation, or a vehicle simulator."""
    with ui.session() as progress:
        if fit.suffix.lower() == ".json":
            from diffthrust.saved._load import load

            files = load(fit, trust=trust or ())
            if not hasattr(files, "export"):
                raise InputError(
                    f"{fit}: expected a saved fit, found a {type(files).__name__}.",
                    "Name the file that fit.save has written.",
                )
        else:
            from diffthrust.specs._spec import load_spec

            files = load_spec(fit, trust=trust or ()).fit(progress=progress)
        exported = files.export(to, output, limits=limits)
    if output is None:
        typer.echo(exported.text)
    for note in exported.notes:
        typer.echo(f"Note: {note}", err=True)
    ui.written(output)
