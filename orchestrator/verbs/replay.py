"""`toppling replay`: one job of a run, repeated in detail."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pyarrow.compute as pc

from toppling.models.errors import InputError
from toppling.models.files.digest import check, read_table
from toppling.orchestrator.run_folder import place_in
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.reader import Run, open_run
from toppling.results.schema import SCHEMA, describe

if TYPE_CHECKING:
    from toppling.models.scene import Scene
    from toppling.workers.job import JobSpec


@click.command()
@shared.run_argument
@click.argument("job")
@option("--out", type=shared.FOLDER, help="Default: RUN/replay/JOB.")
def replay(run: Path, job: str, out: Path | None) -> None:
    """Repeat one JOB of RUN and show how the rock moves.

    It writes the trajectory as a table (Parquet, CSV) and as plots (PNG, SVG), an interactive page that plays the
    motion, and a GIF. It states whether the answer is that of the run, and exits with code 1 if it is not. The
    beginning of a job's id is enough.

    \b
    toppling query runs/first "select job_id, max_tilt_deg from results where toppled limit 3"
    toppling replay runs/first 3dea16b1
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.scene import Scene
    from toppling.results.drawing.trajectory_figures import write_replay
    from toppling.results.replayed_job import Replay
    from toppling.workers.job import Assets, outcome_of, prepared
    from toppling.workers.seating import settled
    from toppling.workers.shaking import shake

    spec, job_id = specification(run, job)
    of_rock = _rock_of(open_run(run), spec.scene_id)
    assets = Assets(Scene.load(of_rock.scene_folder), Ensemble.load(of_rock.ensemble_folder))
    shared.compile_first()
    scene, imposed = prepared(spec, assets)
    with bar("shaking"):
        result = shake(scene, imposed.motion, spec.preset, trajectory=True, engine=spec.engine)
        assert result.trajectory is not None
        shown = Replay(settled(scene), imposed.motion, result.trajectory, result.topple_time_s)
    title = f"{of_rock.rock}: {_as_shaken(spec, assets.scene, scene)}: {result.outcome or result.status}"
    folder = out or place_in(run, f"replay/{job_id}")
    with bar("drawing", 6) as advance:
        for path in write_replay(shown, folder, title):
            click.echo(path)
            advance()
    rows = open_run(run).table()
    (row,) = rows.filter(pc.equal(rows.column("job_id"), job_id)).to_pylist() or [None]
    again = outcome_of(result)
    differing = [] if row is None else [_difference(name, row[name], again[name]) for name in _OUTCOME]
    click.echo(title)
    if row is None:
        click.echo("The run has no answer for this job yet.")
    elif any(differing):
        version = row["physics_version"]
        if spec.job_id != job_id:
            click.echo(f"The run was done with physics version {version}, not with this program's.", err=True)
        raise InputError(
            "replay.differs",
            "; ".join(filter(None, differing)),
            where=f"job {job_id}",
            expected="the answer of the run",
            remedy=_possible_cause(row["kernels"]),
        )
    else:
        click.echo("The answer is that of the run.")


def _as_shaken(spec: "JobSpec", nominal: "Scene", shaken: "Scene") -> str:
    """Description of a job with the draws of its realisation: base, friction, restitution, rotation of the motion."""
    from toppling.results.analysis.fragility import friction_words

    number, contact = spec.realisation, shaken.contact
    base = None if nominal.unseen is None else nominal.unseen.number_of(number)
    turn_deg = spec.unmeasured.turn_deg(number) if spec.unmeasured else 0.0
    drawn = [
        f"base {base}" if base is not None else "nominal" if number == 0 else "",
        f"turned by {turn_deg:.3g}°" if turn_deg else "",
    ]
    remark = ", ".join(filter(None, drawn))
    friction = friction_words(
        *(float(f"{value:.3g}") for value in (contact.friction_static, contact.friction_kinetic))
    )
    bounce = f", restitution {contact.restitution:.2g}" if contact.restitution else ""
    return (
        f"{spec.record_id}, PGA {spec.pga_m_s2:g} m/s², azimuth {spec.azimuth_deg:g}°, "
        f"realisation {number}{f' ({remark})' if remark else ''}, friction {friction}{bounce}"
    )


_OUTCOME = [
    field.name for field in SCHEMA if describe(field)["group"] == "outcome" and field.name != "message"
]


def _rock_of(opened: Run, scene_id: str) -> Run:
    """Run of the rock of an atlas that a job shakes, or the run itself."""
    return next((rock for rock in opened.rocks if rock.entry["scene_id"] == scene_id), opened)


def specification(run: Path, job: str) -> "tuple[JobSpec, str]":
    """Specification of the job whose id begins with the given text, and its full id."""
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.scene import Scene
    from toppling.orchestrator.campaign import Campaign
    from toppling.workers.job import JobSpec

    opened = open_run(run)
    run = opened.root
    path = run / "jobs.parquet"
    if not path.exists():
        raise _error(
            "run.no_plan",
            run,
            "the folder holds no plan (jobs.parquet)",
            "give the folder that 'toppling run' made",
        )
    check(run / "campaign.toml")
    jobs = read_table(path)
    found = jobs.filter(pc.starts_with(jobs.column("job_id"), job)).to_pylist()
    if len(found) != 1:
        what = f"{len(found)} jobs begin with {job!r}" if found else f"no job begins with {job!r}"
        raise _error(
            "run.job_unknown", run, what, 'see the ids with: toppling query RUN "select job_id from results"'
        )
    campaign, (chosen,) = Campaign.read(run / "campaign.toml"), found
    job_id = chosen.pop("job_id")
    of_rock = _rock_of(opened, chosen.pop("scene_id"))
    scene, ensemble = Scene.load(of_rock.scene_folder), Ensemble.load(of_rock.ensemble_folder)
    sha = ensemble.sha(chosen["record_id"])
    return JobSpec(scene_id=scene.id, record_sha=sha, **campaign.settings, **chosen), job_id


def _possible_cause(kernels: str | None) -> str:
    """Possible cause of a different answer: another version, or another machine."""
    from toppling.orchestrator.task import processor

    here = processor()["kernels"]
    remark = "see 'versions' in run.json: the run may come from another version or machine"
    if kernels in (None, here):
        return remark
    return f"the row was computed with other kernels ({kernels}, here {here}): replay it on a like machine; {remark}"


def _difference(name: str, was: object, now: object) -> str:
    from toppling.orchestrator.execution import SAME_NUMBER

    if isinstance(was, float) and isinstance(now, float):
        same = math.isclose(was, now, rel_tol=SAME_NUMBER, abs_tol=SAME_NUMBER)
    else:
        same = was == now
    return "" if same else f"{name} is {now}, but was {was} in the run"


def _error(code: str, run: Path, what: str, remedy: str) -> InputError:
    return InputError(code, what, where=str(run), expected="one job of this run", remedy=remedy)
