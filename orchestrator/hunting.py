"""A hunt on a plan and its store: ladders of the plan, what is known of them, rows of levels that were skipped."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.impose import impose
from toppling.orchestrator.hunt import Choice, Hunt, Ladder
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.task import lost_row
from toppling.results.hunted import SKIPPED
from toppling.results.store import newest_rows, read_steady, result_files
from toppling.workers.options import PHYSICS_VERSION

_CONTACT = ["record_id", "friction_static", "friction_kinetic", "restitution", "realisation"]


def hunt_of(planned: Plan) -> Hunt:
    """Ladders of a plan, those of one record and contact together in the order of the campaign's azimuths."""
    jobs = planned.jobs.to_pandas().reset_index(names="row")
    jobs["record_id"] = jobs["record_id"].astype(str)
    place = {azimuth: number for number, azimuth in enumerate(planned.campaign.azimuth_deg)}
    jobs = jobs.assign(order=jobs["azimuth_deg"].map(place)).sort_values(["order", "pga_m_s2"], kind="stable")
    groups = []
    for _, together in jobs.groupby(_CONTACT, sort=False):
        ladders = [
            Ladder(tuple(levels["row"].tolist()), tuple(levels["job_id"]))
            for _, levels in together.groupby("order")
        ]
        groups.append(ladders)
    return Hunt(groups)


def known_answers(folder: Path) -> dict[str, bool]:
    """Of each job that was shaken whether it toppled; one that has no answer is taken to stand."""
    rows = read_steady([folder], lambda: newest_rows(result_files(folder), ["job_id", "status", "toppled"]))
    shaken = rows.filter(pc.not_equal(rows["status"], SKIPPED))
    toppled = pc.fill_null(shaken["toppled"], fill_value=False).to_pylist()
    return dict(zip(shaken["job_id"].to_pylist(), toppled, strict=True))


def marked(choices: Mapping[str, Choice]) -> dict[str, dict[str, Any]]:
    """What the rows of audits tell beside their answers."""
    return {job_id: _mark(choice) for job_id, choice in choices.items()}


def skipped_rows(planned: Plan, ensemble: Ensemble, choices: list[Choice]) -> Iterator[dict[str, Any]]:
    """Rows of levels that were not shaken, with the intensity that they would have had."""
    for choice in choices:
        spec = planned.spec(choice.row)
        record = ensemble.record(spec.record_id)
        imposed = impose(record, spec.pga_m_s2, spec.azimuth_deg, spec.peak_displacement_m)
        intensity = {name: value for name, value in imposed.intensity.items() if np.isfinite(value)}
        told = {"event": record.event, "physics_version": PHYSICS_VERSION, "attempt": 1, "message": None}
        yield lost_row(spec, SKIPPED, "") | intensity | told | _mark(choice)


def _mark(choice: Choice) -> dict[str, Any]:
    return {"choice_probability": choice.probability, "expected_toppled": choice.expected}
