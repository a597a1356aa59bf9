"""How many jobs a stated precision takes, and whether its interval holds.

    .venv/bin/python benchmarks/precision.py [CAMPAIGNS] [RUN ...]

CAMPAIGNS synthetic campaigns (500; fewer for finer precisions) have a known truth: thresholds lognormal over records,
azimuths and jobs.
Each RUN is a finished grid, on which the design is played back with other seeds: its rows are looked up instead of
shaken. The grid's own curve is that of its jobs between a tenth and nine tenths, each record with one weight.
"""

import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import norm

from toppling.models.motions.measures import LEVEL_MEASURES
from toppling.results.precision.design import Pool, Rounds, Target
from toppling.results.precision.probit import Answers, Curve, answers_of, fit_curve
from toppling.results.reader import open_run

PRECISIONS = {0.1: 1.0, 0.05: 0.3, 0.03: 0.3}
"""Precisions with the fraction of the campaigns that they are tried on: finer ones take thousands of jobs."""
PLAYS = 40
LEVELS = np.arange(1.0, 20.0)
MEDIAN_M_S = 1.0

Ask = Callable[[NDArray[np.int64]], Mapping[str, Answers]]


def play(pool: Pool, ask: Ask, target: Target, precision: float, seed: int) -> Rounds:
    """Rounds on answers that are known."""
    rounds = Rounds(pool, target, precision, seed)
    rounds.advance(None)
    while not rounds.ended:
        rounds.advance(ask(rounds.chosen))
    return rounds


def synthetic(
    seed: int, records: int = 140, azimuths: int = 8, beta: float = 0.35, of_records: float = 0.5
) -> tuple[Pool, Ask]:
    """A campaign whose thresholds are lognormal over records (a share of the variance), azimuths (.15) and jobs."""
    random = np.random.default_rng([seed, 99])
    log_x = (np.log(0.12) + random.normal(0.0, 0.5, records))[:, None] + np.log(LEVELS)
    shape = (records, azimuths, len(LEVELS))
    parts = (
        (of_records, (records, 1, 1)), (0.15, (records, azimuths, 1)), (0.85 - of_records, shape),
    )  # fmt: skip
    deviation = sum(math.sqrt(share) * random.normal(size=size) for share, size in parts)
    toppled = (log_x[:, None, :] > math.log(MEDIAN_M_S) + beta * deviation).ravel()
    pool = Pool(np.arange(toppled.size).reshape(shape), {"pgv_m_s": log_x}, shape[0])

    def ask(chosen: NDArray[np.int64]) -> dict[str, Answers]:
        record, _, level = np.unravel_index(chosen, shape)
        answers = toppled[chosen].astype(float)
        return {"pgv_m_s": Answers(log_x[record, level], answers, record, np.ones(len(chosen)))}

    return pool, ask


def finished(frame: pd.DataFrame) -> tuple[Pool, Ask]:
    """The jobs of a finished grid of one contact."""
    names, cells = ["record_id", "level_pga_m_s2"], ["azimuth_deg", "realisation"]
    jobs = frame.sort_values([names[0], *cells, names[1]], ignore_index=True)
    records = {name: number for number, name in enumerate(jobs["record_id"].unique())}
    levels = jobs["level_pga_m_s2"].nunique()
    rows = np.arange(len(jobs)).reshape(len(records), -1, levels)
    log_x = {name: np.log(jobs[name].to_numpy(float)[rows[:, 0, :]]) for name in LEVEL_MEASURES}
    ids = jobs["job_id"].to_numpy()

    def ask(chosen: NDArray[np.int64]) -> dict[str, Answers]:
        return answers_of(jobs.iloc[chosen], list(ids[chosen]), LEVEL_MEASURES, records)

    return Pool(rows, log_x, len(rows)), ask


def curve_of(answers: Answers) -> Curve:
    """A grid's own curve, each record with one weight, of all jobs that are not certain.

    Far ones would bend it where it is no lognormal; and levels in equal steps give a record of short pulses more jobs
    near the curve than one of long pulses, though both are one record.
    """
    curve = fit_curve(answers)
    for _ in range(5):
        ends = curve.log_x(norm.ppf(np.array([0.1, 0.9])))
        near = (answers.log_x > ends[0]) & (answers.log_x < ends[1])
        record = answers.record[near]
        weight = 1.0 / np.bincount(record)[record]
        curve = fit_curve(Answers(answers.log_x[near], answers.toppled[near], record, weight / weight.mean()))
    return curve


def line(plays: list[Rounds], median: float, beta: float) -> dict[str, float]:
    """What some plays say beside the truth."""
    result = [entry.verdict for entry in plays]
    estimates = [entry.estimate for entry in result if entry is not None and entry.estimate is not None]
    curves = [entry.curve for entry in result if entry is not None and entry.curve is not None]
    off = np.log([estimate.value / median for estimate in estimates])
    jobs = [len(entry.chosen) for entry in plays]
    return {
        "held": float(np.mean([estimate.low <= median <= estimate.high for estimate in estimates])),
        "rms off": float(np.sqrt((off**2).mean())), "lean": float(off.mean()),
        "stated": float(np.mean([estimate.precision for estimate in estimates])),
        "jobs": float(np.median(jobs)), "jobs of 9 in 10": float(np.quantile(jobs, 0.9)),
        "rounds": float(np.mean([len(entry.sizes) for entry in plays])),
        "beta over true": float(np.median([curve.beta for curve in curves]) / beta),
        "cannot": float(np.mean([bool(entry.reason) for entry in result if entry is not None])),
    }  # fmt: skip


def stated_measure(rounds: Rounds) -> str:
    """The measure of a statement."""
    assert rounds.verdict is not None
    return rounds.verdict.measure


def main() -> None:
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    lines: dict[str, dict[str, float]] = {}
    for beta, of_records in ((0.35, 0.5), (0.25, 0.7), (0.5, 0.3)):
        for precision, share in PRECISIONS.items():
            plays = [
                play(*synthetic(seed, beta=beta, of_records=of_records), Target(), precision, seed)
                for seed in range(round(share * campaigns))
            ]
            name = f"beta {beta}, records {of_records}, +-{100 * precision:g} %"
            lines[name] = line(plays, MEDIAN_M_S, beta)
            print(pd.DataFrame({name: lines[name]}).T.round(3).to_string(), flush=True)
    for path in map(Path, sys.argv[2:]):
        pool, ask = finished(open_run(path).frame())
        grid = ask(pool.rows.ravel())
        for precision in (0.1, 0.06):
            plays = [play(pool, ask, Target(), precision, seed) for seed in range(PLAYS)]
            for measure in sorted({stated_measure(value) for value in plays}):
                curve = curve_of(grid[measure])
                own = math.sqrt(sum(curve.variances(Target().score))) * curve.student()
                some = [value for value in plays if stated_measure(value) == measure]
                name = f"{path.name} +-{100 * precision:g} %, {measure}, {len(some)} plays"
                lines[name] = line(some, curve.median, curve.beta) | {"grid's own": own}
    print(pd.DataFrame(lines).T.round(3).to_string())


if __name__ == "__main__":
    main()
