"""The gallery of the documentation, made by the program: `python benchmarks/gallery.py [FOLDER OF A DEMO]`.

Draws into docs/figures and writes docs/gallery.md.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "figures"
TOPPLING = [sys.executable, "-m", "toppling"]

DRAWN = (
    ("scene show {demo}/scene --out {out}", "scene.png", "demo_scene.png", "The rock, its interface and its pedestal"),
    (
        "records show {demo}/ensemble --figure {out}/records.png", "records.png", "demo_records.png",
        "The records: response spectra, PGA and PGV/PGA, magnitude and distance",
    ),
    (
        "fragility {demo}/run --fit --out {out}", "pga_pgv_pga.png", "demo_pga_pgv_pga.png",
        "Toppling probability over PGA and PGV/PGA",
    ),
    (None, "pga_pgv_pga_by_direction.png", "demo_by_direction.png", "The same by direction of shaking"),
    (None, "pga_pgv.png", "demo_pga_pgv.png", "Toppling probability over PGA and PGV"),
    (None, "directions.png", "demo_directions.png", "Where the rock topples to, and the acceleration needed"),
    (None, "fits/fits.png", "demo_fits.png", "Fragility curves with intervals from resampled records"),
    (
        "constrain {demo}/run --age 15000..30000 --hazard {demo}/mean.csv=0.6 --hazard {demo}/high.csv=0.4 --out {out}",
        "constraint.png", "demo_constraint.png",
        "Rates that are inconsistent with the standing rock, and two hazard curves",
    ),
)  # fmt: skip
"""Command (None: as the one before), picture that it draws, name in the documentation, caption."""

HEAD = """\
# Gallery

`make gallery` runs the demo and redraws all figures. [From a cloud to a constraint](guide/python.md) in Python.
"""

HAZARD = {"mean.csv": 3e-4, "high.csv": 3e-3}
"""Annual rate at which each made-up hazard curve exceeds a PGV of 0.2 m/s; it falls with the square of PGV."""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        demo = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "demo"
        if not demo.exists():
            subprocess.run([*TOPPLING, "demo", "--out", str(demo)], check=True)
        for name, rate in HAZARD.items():
            rows = [
                f"{pgv},{rate * (0.2 / pgv) ** 2:.3g}\n" for pgv in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
            ]
            (demo / name).write_text("pgv_m_s,annual_rate\n" + "".join(rows), encoding="utf-8")
        parts, out = [HEAD], Path(folder) / "out"
        for command, drawn, name, caption in DRAWN:
            if command:
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                words = [word.format(demo=demo, out=out) for word in command.split()]
                subprocess.run([*TOPPLING, *words], check=True, stdout=subprocess.DEVNULL)
                parts.append(f"From `toppling {command.format(demo='demo', out='pictures')}`:\n")
            shutil.copy(out / drawn, FIGURES / name)
            parts.append(f"![{caption}](figures/{name})\n")
    (ROOT / "docs" / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
