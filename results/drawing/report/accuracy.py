"""How far the answers of a run may be off."""

import json
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from toppling.results.drawing.report.document import safe

_BUDGET = Path(__file__).parents[2] / "preset_budget.json"
"""Error and flips of the presets, as `benchmarks/accuracy.py` measured them last."""


def accuracy_section(frame: pd.DataFrame) -> str:
    """Preset and time step, deepest overlap, and what was measured of the preset."""
    presets, engines = (", ".join(sorted(frame[name].unique())) for name in ("preset", "engine"))
    # A preset's steps may differ beyond the digits that are shown.
    steps = ", ".join(dict.fromkeys(f"{step:g}" for step in sorted(frame["time_step_s"].dropna())))
    lines = [f"<p>Engine {safe(engines)}; preset {safe(presets)}; time step {steps or 'not stated'} s.</p>"]
    if frame["penetration_m"].notna().any():
        lines.append(f"<p>Deepest overlap of rock and pedestal {frame['penetration_m'].max():.2g} m.</p>")
    return "".join([*lines, *_budget(frame)])


def _budget(frame: pd.DataFrame) -> Iterator[str]:
    """What was measured of the run's presets on the demo's rock, by the program's own benchmark."""
    told = json.loads(_BUDGET.read_text(encoding="utf-8"))
    versions = sorted(frame["physics_version"].dropna().unique())
    if versions and versions != [told["physics_version"]]:
        yield (
            f"<p>The presets were measured with physics version {safe(told['physics_version'])}; this run's "
            f"is {safe(', '.join(versions))}.</p>"
        )
    jobs, floor = told["jobs"], told["floor_of_chaos"]
    for preset in sorted(frame["preset"].unique()):
        measured = told["presets"].get(preset)
        if measured is None:
            yield f"<p>Preset {safe(preset)} was not measured.</p>"
            continue
        up, down = measured["flips_to_toppled"], measured["flips_to_standing"]
        yield (
            f"<p>On the demo's rock, of {jobs} jobs near and beyond their thresholds "
            f"({100 * told['toppled_share']:.0f} % topple) {100 * (up + down) / jobs:.1f} % have another answer with "
            f"preset {safe(preset)} than with reference: {up} topple that stood, {down} stand that toppled. "
            f"{100 * floor:.1f} % flip already when the rock's start is disturbed by a millionth of its height, "
            f"{100 * told['floor_of_chaos_of_motion']:.1f} % when the motion is, and "
            f"{100 * told['flips_of_half_the_step']:.1f} % when reference takes half its step: one job is no "
            "statement about a rock, the share of many is. Least overturning pulses of blocks are met within "
            f"{100 * measured['largest_threshold_error']:.2g} % of the exact integrator. None of this was measured on "
            "this run's rock: <code>toppling accuracy</code> says it of yours.</p>"
        )
