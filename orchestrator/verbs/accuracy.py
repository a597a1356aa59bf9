"""`toppling accuracy`: how much a rock's answers depend on the numerical settings, and what each setting costs."""

from pathlib import Path

import click
import pandas as pd

from toppling.models.files.csv_text import write_csv
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.progress import bar
from toppling.orchestrator.studies import accuracy as study
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.drawing.study_figures import front_figure
from toppling.results.drawing.style import save
from toppling.workers.options import PRESETS


@click.command()
@shared.scene_argument
@shared.ensemble_argument
@shared.folder_out
@option("--jobs", "count", type=click.IntRange(10), default=200, help="Number of jobs.")
@option(
    "--pga", "pga_m_s2", type=(float, float), default=(3.0, 15.0), metavar="LOW HIGH",
    help="Range from which PGA is drawn, m/s2.",
)  # fmt: skip
@shared.processes_option
def accuracy(
    scene: Path, ensemble: Path, out: Path, count: int, pga_m_s2: tuple[float, float], workers: int
) -> None:
    """Compare the answers and the cost of the presets for the rock of SCENE under motions of ENSEMBLE.

    Jobs of random record, level and azimuth are shaken with every preset of every installed engine. The presets are
    compared by how far they shift, against 'reference', the PGA at which half topple, the share that topples and the
    tilt of rocks that stand, each with its standard deviation. Single answers near a threshold are chaotic: the row
    'reference, disturbed' is 'reference' from a start disturbed by a millionth of the rock's height. Friction and
    restitution are those of the scene, not of a campaign.

    It writes accuracy.csv and the front of error against cost (front.png, front.svg). Answers are kept in OUT/answers:
    the same command resumes an interrupted comparison, and a larger --jobs extends it.

    \b
    toppling accuracy scenes/rock ensembles/quakes --jobs 200 --out accuracy
    """
    rock, motions = Scene.load(scene), Ensemble.load(ensemble)
    jobs = study.draw_jobs(motions, count, pga_m_s2)
    compared = study.settings()
    compared[study.FLOOR] = study.Setting(PRESETS[study.CONVERGED], disturbed_toward_deg=0.0)
    with bar("shaking", count * len(compared)) as advance:
        said = {
            name: study.answers(
                rock, motions, jobs, one, processes=workers, advance=advance, kept=out / "answers"
            )
            for name, one in compared.items()
        }
    table = study.compare(said, said[study.CONVERGED])
    save(front_figure(table), out / "front")
    written = write_csv(table, out / "accuracy.csv", digits=None)
    click.echo(_summary(table))
    click.echo(f"{written}\n{out / 'front.png'}")


def _summary(table: pd.DataFrame) -> str:
    """The ranking as a readable table."""
    percent = {"median_shift": "median PGA", "share_shift": "share toppled", "tilt_log_ratio": "tilt"}
    shown = {"setting": table["setting"], "s a job": table["processor_s_per_job"].map("{:.3f}".format)}
    for column, label in percent.items():
        pairs = zip(100.0 * table[column], 100.0 * table[f"{column}_std"], strict=True)
        shown[f"{label}, %"] = [f"{value:+.1f} ± {std:.1f}" for value, std in pairs]
    shown["answers that differ"] = [
        f"{row.flips_to_toppled} up, {row.flips_to_standing} down of {row.jobs}" for row in table.itertuples()
    ]
    return pd.DataFrame(shown).to_string(index=False)
