"""How far the answers of a run may be off."""

import pandas as pd

from toppling.results.analysis.audit_statistics import Audit, audits_of
from toppling.results.drawing.report.document import Document, safe
from toppling.results.reader import Run


def accuracy_section(run: Run, frame: pd.DataFrame, document: Document) -> str:
    """Engine, preset and time step, deepest penetration, and the results of the run's audit."""
    presets, engines = (", ".join(sorted(frame[name].unique())) for name in ("preset", "engine"))
    # A preset's steps may differ beyond the digits that are shown.
    steps = ", ".join(dict.fromkeys(f"{step:g}" for step in sorted(frame["time_step_s"].dropna())))
    lines = [f"<p>Engine {safe(engines)}; preset {safe(presets)}; time step {steps or 'not stated'} s.</p>"]
    if frame["penetration_m"].notna().any():
        lines.append(f"<p>Deepest penetration of rock and pedestal {frame['penetration_m'].max():.2g} m.</p>")
    audits = audits_of(run)
    lines += [f"<p>{safe(audit.sentence)}.</p>" for audit in audits.values()]
    if not audits:
        lines.append(
            "<p>This run has not been audited: <code>toppling audit RUN --jobs 200</code> repeats a sample of its jobs "
            "and states how far its answers may be off.</p>"
        )
    else:
        caption = "Repeated jobs: differences of the run, with 95 % intervals."
        lines.append(document.table(pd.DataFrame(map(_row, audits.values())), caption))
        lines.append(
            "<p>Near a threshold the answer to a single job is chaotic, whatever the settings; only the share of many "
            "jobs is meaningful.</p>"
        )
    return "".join(lines)


def _row(audit: Audit) -> dict[str, object]:
    """An audit as the page shows it; its other numbers are in `audit.csv`."""
    return {
        "again with": audit.by,
        "jobs": audit.jobs,
        "topple in the run only": audit.flips_to_toppled,
        "again only": audit.flips_to_standing,
        "median PGA, %": audit.median_shift_percent.text("{:+.1f}") if audit.tells else "too few jobs",
        "share toppled": audit.share_shift.text("{:+.3f}") if audit.tells else "too few jobs",
        "ln tilt of those standing": audit.tilt_log_ratio.text("{:+.2f}"),
    }
