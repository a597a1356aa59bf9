"""Small seeded runs with a law that the tests know: P(topple) = Phi(ln(pgv / theta) / beta)."""

import datetime
import math

import numpy as np
from scipy.stats import norm

THETA_M_S, BETA = 1.2, 0.4


def rows(records=20, levels=range(1, 20), azimuths=(0.0, 90.0), seed=7, friction=1.0):
    """Rows of a campaign whose toppling is lognormal in PGV and independent between jobs."""
    random = np.random.default_rng(seed)
    pulse_s = np.exp(random.normal(math.log(0.12), 0.5, records))
    duration_s = random.uniform(4.0, 29.0, records)
    peak_off_deg = random.uniform(-22.0, 22.0, records)
    table = []
    for record in range(records):
        for azimuth in azimuths:
            for level in levels:
                pgv = level * pulse_s[record]
                toppled = random.random() < norm.cdf(math.log(pgv / THETA_M_S) / BETA)
                table.append(
                    row(
                        f"R{record:03d}-{azimuth:g}-{level:g}-{friction:g}",
                        record_id=f"R{record:03d}",
                        level_pga_m_s2=float(level),
                        pga_m_s2=float(level),
                        azimuth_deg=azimuth,
                        ground_accelerates_toward_deg=(azimuth + peak_off_deg[record]) % 360.0,
                        pgv_m_s=pgv,
                        pgv_pga_s=pulse_s[record],
                        duration_energy_s=duration_s[record],
                        arias_m_s=0.1 * level**2 * duration_s[record],
                        friction_static=friction,
                        friction_kinetic=friction,
                        toppled=toppled,
                        outcome="toppled" if toppled else "stands",
                        falls_toward_deg=random.normal(135.0, 15.0) % 360.0 if toppled else None,
                    )
                )
    return table


def row(job_id, **values):
    """Row that is complete but for what the test does not look at."""
    fixed = {
        "job_id": job_id, "scene_id": "scene", "record_id": "R000", "level_pga_m_s2": 1.0, "azimuth_deg": 0.0,
        "friction_static": 1.0, "friction_kinetic": 1.0, "restitution": 0.0, "realisation": 0,
        "preset": "standard", "engine": "pybullet", "status": "ok", "attempt": 1,
        "finished_at": datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC),
    }  # fmt: skip
    return fixed | values
