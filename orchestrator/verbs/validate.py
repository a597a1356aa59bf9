"""`toppling validate`: predictions of an experiment's tests, scored against the outcomes."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.files.csv_text import write_csv
from toppling.models.files.folder import write_text
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.shaketable import Experiment, read_experiment
from toppling.orchestrator.cluster import local
from toppling.orchestrator.context import RunError
from toppling.orchestrator.progress import bar, watcher
from toppling.orchestrator.studies import validation as study
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.analysis import prediction_scores as scored
from toppling.results.drawing.study_figures import calibration_figure
from toppling.results.drawing.style import save
from toppling.workers.options import PRESETS

_MEASURES = ("pga_m_s2", "pgv_m_s", "pgv_pga_s")


@click.command()
@click.argument("folder", type=shared.EXISTING_FOLDER)
@option(
    "--mesh", required=True, type=shared.FILE,
    help="Closed mesh of the specimen, metres, z up, x along the table; a bare name is also looked up in FOLDER.",
)  # fmt: skip
@option(
    "--outcome", required=True, metavar="COLUMN", help="Column of outcomes, 0 or 1, such as sp1_overturned."
)
@option("--learn", is_flag=True, help="Weight the draws by the outcomes of other records.")
@option("--out", type=shared.FOLDER, help="Folder to write to. Default: validation/MESH-ENGINE-PRESET.")
@option(
    "--draws", "most_draws", type=click.IntRange(4), default=288,
    help="Largest number of realisations per test.",
)  # fmt: skip
@option(
    "--error", type=click.FloatRange(0, 0.5, min_open=True), default=0.03,
    help="Standard error of a test's share below which no draws are added.",
)  # fmt: skip
@shared.engine_option
@option("--preset", type=click.Choice(list(PRESETS)), default="draft", help="Numerical settings.")
@option("--seed", type=int, default=0, help="Random seed of the bases.")
@shared.workers_option()
@shared.json_option()
def validate(
    folder: Path,
    mesh: Path,
    outcome: str,
    learn: bool,
    out: Path | None,
    workers: int | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Predict the shake-table tests of FOLDER as probabilities and score them against the outcomes.

    FOLDER holds tests.csv and motions.parquet (docs/validation.md).
    Unmeasured properties are drawn: the base, friction, restitution (if the engine knows it), yaw and the sense of the
    table. The probability is the share of draws that topple. No outcome is used, except with --learn, which weights
    draws by the outcomes of other records, never of the one predicted. Scores of others' predictions in the table of
    tests and of simple rules are given for comparison. The same command resumes an interrupted validation.

    \b
    toppling validate shaketable --mesh sp1.ply --outcome sp1_overturned
    toppling validate shaketable --mesh sp1.ply --outcome sp1_overturned --learn --json
    """
    mesh = mesh if mesh.exists() else folder / mesh
    with bar("reading tests"):
        experiment = read_experiment(folder, outcome)
    for warning in experiment.warnings:
        click.echo(f"warning: {warning}", err=True)
    if learn and len({test.ground_motion for test in experiment.tests}) < 2:
        raise InputError(
            "all tests follow one record",
            where=str(folder),
            expected="two records or more: each is predicted from the others",
            remedy="leave --learn out, or give the record of each test (docs/validation.md)",
        )
    sampling = study.Sampling(**asked)
    folder = out or Path("validation") / f"{mesh.stem}-{sampling.engine}-{sampling.preset}"
    with bar("measuring motions", len(experiment.tests)) as advance:
        ensemble = study.ensemble_of(folder, experiment, advance)
    with bar("drawing bases", sampling.most_draws) as advance:
        study.scene_of(folder, mesh, sampling, lambda kept: advance(kept - advance.done))
    try:
        shaken = study.shake_tests(
            folder, experiment, sampling, partial(local, workers or os.cpu_count() or 1), watcher
        )
    except RunError as stopped:
        raise click.ClickException(
            f"{stopped}; the rows so far are kept, and the same command resumes"
        ) from None
    statement = _summary(experiment, ensemble, shaken, learn, sampling)
    _write(folder, statement, "learnt" if learn else "unlearnt")
    click.echo(json.dumps(statement) if as_json else _words(statement, folder))


def _summary(
    experiment: Experiment, ensemble: Ensemble, shaken: study.Shaken, learn: bool, sampling: study.Sampling
) -> dict[str, Any]:
    """All results."""
    overturned = np.array([test.overturned for test in experiment.tests])
    group = np.array([test.ground_motion for test in experiment.tests])
    answered = np.asarray(np.isfinite(shaken.toppled).any(axis=0), bool)
    if not answered.any():
        raise InputError(
            "no draw has an answer to any test",
            where="validate",
            expected="completed shakes",
            remedy="'toppling status' of the folders realisations_... shows why",
        )
    probability, error = scored.share(shaken.toppled)
    if learn:
        with bar("learning the base"):
            probability = scored.learnt(shaken.toppled, overturned, group)
    catalog = ensemble.catalog.to_pandas().set_index("record_id")
    intensity = catalog.loc[[test.record_id for test in experiment.tests], list(_MEASURES)]
    rules = scored.simple_rules(intensity, overturned, group)
    peers = _peers(experiment)
    nominal = np.isfinite(shaken.nominal)
    return {
        **scored.scores(overturned[answered], probability[answered]),
        "learnt": learn,
        "without_answer": int((~answered).sum()),
        "without_motion": experiment.without_motion,
        "largest_error": float(error.max()),
        "draws": int(shaken.shaken.max()),
        "shakes": int(shaken.shaken.sum()),
        "intervals": scored.intervals(overturned[answered], probability[answered], group[answered]),
        "were_a_draw_true": None if learn else scored.were_a_draw_true(shaken.toppled),
        "mesh_as_it_is": scored.scores(overturned[nominal], shaken.nominal[nominal])
        if nominal.any()
        else None,
        "peers": {
            name: scored.scores(overturned[known], said[known]) for name, (known, said) in peers.items()
        },
        "rules": {name: scored.scores(overturned, said) for name, said in rules.items()},
        "settings": {
            **asdict(sampling),
            **study.drawn_bases(sampling),
            "unmeasured": asdict(study.unmeasured(sampling.engine)),
        },
        "tests": [
            {
                "test_no": test.test_no,
                "ground_motion": test.ground_motion,
                "overturned": test.overturned,
                "probability": float(probability[number]),
                "error": float(error[number]),
                "draws": int(shaken.shaken[number]),
                "share": float(np.nanmean(shaken.toppled[:, number])),
            }
            for number, test in enumerate(experiment.tests)
            if answered[number]
        ],
    }


def _peers(experiment: Experiment) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Others' predictions by name: which tests have one, and its value."""
    names = sorted({name for test in experiment.tests for name in test.predicted})
    said = {
        name: np.array([float(test.predicted.get(name, np.nan)) for test in experiment.tests])
        for name in names
    }
    return {name: (np.isfinite(each), each) for name, each in said.items()}


def _write(folder: Path, statement: Mapping[str, Any], name: str) -> None:
    """JSON, the tests' table, the scores' table and the calibration plot."""
    write_text(json.dumps(statement, indent=1) + "\n", folder / f"{name}.json")
    tests = pd.DataFrame(statement["tests"])
    write_csv(tests, folder / f"{name}_tests.csv", digits=None)
    write_csv(scored.table(_rows(statement)), folder / f"{name}_scores.csv", digits=None, index=True)
    overturned, probability = tests["overturned"].to_numpy(bool), tests["probability"].to_numpy(float)
    title = f"{statement['n']} tests, Brier score {statement['brier']:.3f}"
    drawn = calibration_figure(scored.calibration(overturned, probability), probability, overturned, title)
    save(drawn, folder / f"{name}_calibration")


def _rows(statement: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    rows = {"toppling, base learnt" if statement["learnt"] else "toppling": statement}
    if statement["mesh_as_it_is"]:
        rows["toppling, the mesh as it is"] = statement["mesh_as_it_is"]
    return {**rows, **statement["rules"], **statement["peers"]}


def _words(statement: Mapping[str, Any], folder: Path) -> str:
    lines = [scored.table(_rows(statement)).to_string(float_format="{:.3f}".format, na_rep="-"), ""]
    if statement["intervals"]:
        lines.append("95 % over records: " + _ends(statement["intervals"]))
    else:
        lines.append(
            "all tests follow one record: no intervals over records, no rules fitted to other records"
        )
    if statement["were_a_draw_true"]:
        lines.append("90 % if a draw were the specimen: " + _ends(statement["were_a_draw_true"]))
    counts = statement["confusion"]
    lines.append(
        f"overturned: {counts['overturned_called_overturned']} predicted, {counts['overturned_called_standing']} not; "
        f"stood: {counts['standing_called_standing']} predicted, {counts['standing_called_overturned']} not"
    )
    lines.append(
        f"{statement['shakes']} shakes, at most {statement['draws']} draws per test, error of a share at most "
        f"{statement['largest_error']:.3f}; {statement['without_motion']} tests have no motion"
    )
    lines.append(f"{folder}: JSON, tables (CSV) and the calibration plot")
    return "\n".join(lines)


def _ends(intervals: Mapping[str, list[float | None]]) -> str:
    known = {name: pair for name, pair in intervals.items() if None not in pair}
    return ", ".join(f"{name} {low:.3f} to {high:.3f}" for name, (low, high) in known.items())
