"""Sequential selection of jobs until a statement has the precision that a campaign requests.

Rounds are reconstructed from the store at every start, each only from the rows of earlier rounds, so that they do not
depend on the number of workers or on interruptions.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.errors import InputError, counted
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.measures import LEVEL_MEASURES, SCALING_POWER
from toppling.orchestrator.campaign import Campaign, TargetSpec
from toppling.orchestrator.journal import log_event
from toppling.orchestrator.plan import Plan, Rows
from toppling.orchestrator.run_folder import set_jobs
from toppling.results.analysis.lognormal import EVENT_FRACTION, earthquakes
from toppling.results.analysis.resampling import narrowed_by
from toppling.results.precision.design import Pool, Rounds, Target, statement_of, write_statements
from toppling.results.precision.probit import answers_of
from toppling.results.reader import open_run

_CONTACT = ("friction_static", "friction_kinetic", "restitution")


class JobsForPrecision:
    """Rounds of jobs until the target has the requested precision, separately for one contact after another.

    folder: the run's folder, where the statement is written.
    Raises InputError if the records lack the target's measure.
    """

    def __init__(
        self, planned: Plan, folder: Path, precision: float, asked: TargetSpec | None = None
    ) -> None:
        self.planned, self.folder = planned, folder
        self.statements: list[dict] = []
        self.ids = planned.jobs["job_id"].to_pylist()
        self.target = _target_of(asked or TargetSpec())
        catalog = Ensemble.load(planned.campaign.ensemble).catalog.to_pandas().set_index("record_id")
        names = sorted(planned.scenes[0].record_sha)
        codes, _ = pd.factorize(earthquakes(catalog.loc[names].reset_index()))
        self.records = dict(zip(names, codes.tolist(), strict=True))
        self.measures = _usable_measures(catalog.loc[names], self.target, str(planned.campaign.ensemble))
        seed = int(planned.id[:8], 16)
        self.rounds = {
            contact: Rounds(pool, self.target, precision, seed)
            for contact, pool in _pools(planned, catalog.loc[names], self.measures, len(set(codes))).items()
        }

    @property
    def ended(self) -> bool:
        """Whether every contact has its statement."""
        return all(rounds.ended for rounds in self.rounds.values())

    @property
    def what(self) -> str:
        """Description of the current round for progress displays."""
        verdicts = [rounds.verdict for rounds in self.rounds.values()]
        known = [
            verdict.estimate.precision
            for verdict in verdicts
            if verdict is not None and verdict.estimate is not None
        ]
        sure = f", +-{100 * max(known):.2g} %" if len(known) == len(verdicts) else ""
        return f"round {max(len(rounds.sizes) for rounds in self.rounds.values())}{sure}"

    def __len__(self) -> int:
        needed = 0
        for rounds in self.rounds.values():
            more = (
                0
                if rounds.ended
                else max(1, rounds.verdict.jobs_needed - len(rounds.chosen) if rounds.verdict else 1)
            )
            needed += len(rounds.chosen) + more
        return needed

    def pending(self, finished: set[str]) -> Rows:
        """Rows of the plan to shake next, in the order to start them (`JobSelection`)."""
        while True:
            waiting = [
                row
                for rounds in self.rounds.values()
                for row in rounds.chosen
                if self.ids[row] not in finished
            ]
            if waiting:
                wanted = np.zeros(len(self.planned), bool)
                wanted[waiting] = True
                return self.planned.order[wanted[self.planned.order]]
            if self.ended:
                return np.array([], np.int64)
            self._advance(finished)

    def _advance(self, finished: set[str]) -> None:
        """Judge the rounds whose jobs all have rows, and choose the next ones."""
        frame, scan = pd.DataFrame(), {}
        if any(rounds.sizes for rounds in self.rounds.values()):
            run = open_run(self.folder)
            frame, scan = run.weighted(run.frame()), run.scene_report()
        self.statements = []
        for contact, rounds in self.rounds.items():
            if not rounds.ended:
                jobs = [self.ids[row] for row in rounds.chosen]
                rounds.advance(answers_of(frame, jobs, self.measures, self.records) if rounds.sizes else None)
            if rounds.verdict is not None:
                self.statements.append(self._statement(frame, contact, rounds, scan))
        if self.statements:
            write_statements(self.folder, self.statements, self.planned.id)
        there = finished | {self.ids[row] for rounds in self.rounds.values() for row in rounds.chosen}
        set_jobs(self.folder, len(there) if self.ended else max(len(self), len(there) + 1))
        sizes = [len(rounds.chosen) for rounds in self.rounds.values()]
        log_event(
            "rounds chosen",
            jobs=sum(sizes),
            ended=self.ended,
            sentences=[statement["sentence"] for statement in self.statements],
        )

    def _statement(
        self, frame: pd.DataFrame, contact: tuple[float, ...], rounds: Rounds, scan: dict[str, Any]
    ) -> dict:
        """Statement from the judged jobs; those of the next round have no rows yet."""
        there = frame[frame["job_id"].isin([self.ids[row] for row in rounds.chosen[: rounds.judged]])]
        there = there[there["toppled"].notna()]
        named = dict(zip(_CONTACT, contact, strict=True))
        found = statement_of(rounds, len(there), there["record_id"].nunique(), named)
        if found["value"] is None or found["base"] <= found["precision"]:
            return found
        narrowed = narrowed_by({"records": found["precision"], "base": found["base"]}, scan)
        return {**found, "sentence": f"{found['sentence']}. {narrowed}"}


def borne_words(campaign: Campaign) -> str:
    """Remark on the precision that a campaign's records support a priori, and when its run ends; empty if unknown."""
    assert campaign.precision is not None
    catalog = Ensemble.load(campaign.ensemble).catalog.to_pandas()
    of_records = earthquakes(catalog[catalog["record_id"].isin(campaign.records or catalog["record_id"])])
    records, fractions = len(of_records), of_records.value_counts(normalize=True)
    worth = 1.0 / (EVENT_FRACTION * float((fractions**2).sum()) + (1.0 - EVENT_FRACTION) / max(records, 1))
    borne = _target_of(campaign.target or TargetSpec()).borne_by(worth)
    if borne is None:
        return ""
    asked = f"±{100 * campaign.precision:.2g} %"
    ends = asked if borne <= campaign.precision else f"what they bear, and {asked} may need more of them"
    of = "" if len(fractions) == records else f" of {len(fractions)} earthquakes"
    return f"{counted(records, 'record')}{of} bear about ±{100 * borne:.2g} % at a usual beta: the run ends at {ends}"


def _target_of(asked: TargetSpec) -> Target:
    """Target of a campaign, with its hazard curve."""
    if asked.hazard is not None:
        from toppling.results.hazard.readers import read_hazard

        trees = [
            tree for tree in read_hazard(asked.hazard) if tree.measure == (asked.measure or tree.measure)
        ]
        if len(trees) != 1 or len(trees[0].curves) != 1 or trees[0].measure not in LEVEL_MEASURES:
            raise InputError(
                "hazard.several_curves",
                f"holds {sum(len(tree.curves) for tree in trees)} curves of {', '.join(t.measure for t in trees)}",
                where=str(asked.hazard),
                expected=f"one hazard curve, of one of {', '.join(LEVEL_MEASURES)}",
                remedy="write the curve that is meant as two columns, or state its measure in the target",
            )
        return Target("rate", trees[0].measure, hazard=trees[0].curves[0])
    if asked.at is not None:
        return Target("probability", asked.measure, intensity=asked.at)
    return Target(asked.of, asked.measure)


def _usable_measures(catalog: pd.DataFrame, target: Target, where: str) -> list[str]:
    """Measures that every record has, or the target's measure; InputError if a record lacks that."""
    wanted = [target.measure] if target.measure else list(LEVEL_MEASURES)
    usable = [name for name in wanted if name in catalog and (catalog[name].fillna(0.0) > 0).all()]
    if not usable:
        raise InputError(
            "ensemble.measure_missing",
            f"not every record has a {' or '.join(wanted)} above 0",
            where=where,
            expected="a measure by which levels can be chosen",
            remedy="ask for another measure, or leave such records out",
        )
    return usable


def _pools(
    planned: Plan, catalog: pd.DataFrame, measures: list[str], independent: int
) -> dict[tuple[float, ...], Pool]:
    """Jobs of each contact, by record, cell (azimuth, with the realisations of its jobs) and level."""
    jobs = planned.jobs.to_pandas().astype({"record_id": str}).reset_index(names="row")
    levels = np.sort(np.array(planned.campaign.pga_m_s2))
    log_scale = np.log(levels)[None, :] - np.log(catalog["pga_m_s2"].to_numpy(float))[:, None]
    log_x = {
        name: np.log(catalog[name].to_numpy(float))[:, None] + SCALING_POWER[name] * log_scale
        for name in measures
    }
    found = {}
    for contact, of_contact in jobs.groupby(list(_CONTACT)):
        point = of_contact.groupby(["record_id", "azimuth_deg", "pga_m_s2"], sort=False)
        ordered = of_contact.assign(turn=point.cumcount()).sort_values(
            ["record_id", "azimuth_deg", "turn", "pga_m_s2"]
        )
        rows = ordered["row"].to_numpy(np.int64).reshape(len(catalog), -1, len(levels))
        found[tuple(float(value) for value in contact)] = Pool(rows, log_x, independent)
    return found
