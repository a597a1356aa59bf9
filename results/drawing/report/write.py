"""The report as HTML and as PDF."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.folder import new_file
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.report.sections import SECTIONS
from toppling.results.drawing.templates import Document, Section, rendered
from toppling.results.reader import Run

_BROWSERS = "chromium chromium-browser google-chrome google-chrome-stable chrome msedge microsoft-edge"
_PRINTING_S = 300.0
"""Time limit for a browser to print."""


def report_page(content: Content, advance: Callable[[str], object] = lambda _: None) -> str:
    """HTML of the page about a run, with its pictures inside.

    advance: called with the name of each section once it is done.
    Raises InputError if no job has an answer yet.
    """
    document = Document(content.completeness.remark)
    first = first_screen(content, document)
    written: list[Section] = []
    for title, write in SECTIONS.items():
        if blocks := write(content, document):
            written.append((title, blocks))
        advance(title)
    title = f"toppling: {content.run.rock} ({content.run.name})"
    return rendered("report.html", title=title, sections=written, **first)


def provenance(run: Run) -> dict[str, Any]:
    """Provenance of a page: ids, versions, what was asked, and the meaning of every column."""
    known, campaign = run.provenance(), run.root / "campaign.toml"
    columns = ("created_at", "jobs", "plan_id", "scene_id", "ensemble_id", "versions", "engine")
    return {
        "run": run.name,
        "page_written_by": f"toppling {version('toppling')}",
        **{name: known[name] for name in columns if name in known},
        "campaign": campaign.read_text(encoding="utf-8") if campaign.exists() else None,
        "columns": run.describe(),
    }


def write_pdf(text: str, target: Path) -> Path:
    """Print the page to PDF, with WeasyPrint if it is installed, else with a headless browser.

    Raises InputError if there is neither.
    """
    try:
        from weasyprint import HTML
    except (ImportError, OSError):  # OSError: its system library Pango is missing
        return _printed_by_browser(text, target)
    with new_file(target) as hidden:
        HTML(string=text).write_pdf(hidden)
    return target


def _printed_by_browser(text: str, target: Path) -> Path:
    browser = next(filter(None, map(shutil.which, _BROWSERS.split())), None)
    if browser is None:
        raise InputError(
            "package.not_installed",
            "no program that prints to PDF is installed",
            where=str(target),
            expected="WeasyPrint, or Chromium, Chrome or Edge on the PATH",
            remedy="'pip install weasyprint' (it needs the system library Pango), or print the page from a browser",
        )
    with tempfile.TemporaryDirectory() as folder, new_file(target) as hidden:
        source, printed = Path(folder) / "report.html", Path(folder) / "report.pdf"
        source.write_text(text, encoding="utf-8")
        command = [
            browser, "--headless=new", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={folder}/profile",
            f"--print-to-pdf={printed}", source.as_uri(),
        ]  # fmt: skip
        if os.geteuid() == 0:
            command.insert(1, "--no-sandbox")  # Chromium has no sandbox for root
        subprocess.run(command, check=True, capture_output=True, timeout=_PRINTING_S)
        shutil.copyfile(printed, hidden)
    return target
