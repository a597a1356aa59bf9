"""The page holds everything a reviewer asks for, and needs nothing but itself."""

import base64
import html.parser
import io
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from PIL import Image
from refusals import refused
from seeded import THETA_M_S, row, rows

sys.path.insert(0, str(Path(__file__).parents[2]))
from browser import needs_browser, overflow

from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.report.sections import SECTIONS, fit_table
from toppling.results.drawing.report.write import report_page, write_pdf
from toppling.results.drawing.templates import Document
from toppling.results.hazard.curves import HazardCurve
from toppling.results.hazard.tree import Branch, HazardTree
from toppling.results.reader import open_run
from toppling.results.store import write_part


class Page(html.parser.HTMLParser):
    """What a browser would load and show."""

    VOID = ("img", "meta", "br", "source", "wbr")

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.sources, self.cells, self.anchors = [], [], [], 0, set()
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self.cells += tag == "td"
        self.anchors |= {value for name, value in attrs if name == "id"}
        self.sources += [value for name, value in attrs if name in ("src", "href", "srcset", "action")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "run <1>"
    folder.mkdir()
    write_part(folder, rows(records=12, levels=(4, 8, 12), azimuths=(0.0, 135.0)))
    write_part(
        folder,
        [row("5162611b55ade96713b9ba77", status="diverged", message="worker <died>: ended by speed_limit")],
    )
    Scene.block(0.2, 0.2, 0.6).save(folder / "scene")
    (folder / "campaign.toml").write_text('preset = "standard"\nscene = "scenes/balanced <rock>"\n')
    return open_run(folder)


@pytest.fixture(scope="module")
def page(run):
    x = np.array([0.05, 0.5, 5.0])
    branches = [
        Branch(name, 0.5, HazardCurve(name, "pgv_m_s", x, rate * x**-2.0))
        for name, rate in (("quiet", 1e-9), ("loud", 1e-2))
    ]
    return report_page(
        Content(run, 5, np.array([2e4]), "20,000 years", HazardTree("pgv_m_s", tuple(branches)))
    )


@pytest.mark.slow
def test_the_page_loads_nothing_from_elsewhere_and_its_pictures_are_whole(page):
    sources = [source for source in Page(page).sources if not source.startswith("#")]
    assert len(sources) >= 8
    for source in sources:
        kind, _, data = source.partition(",")
        assert kind == "data:image/png;base64"
        Image.open(io.BytesIO(base64.b64decode(data))).verify()
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert "http" not in words
    assert "<script" not in words


def test_a_median_beyond_what_was_shaken_is_no_number_and_samples_without_fit_are_counted():
    known = pd.DataFrame({"pga_m_s2": [1.0, 5.0], "pgd_m": [0.1, 0.2], "cav_m_s": [1.0, 2.0]})
    summary = pd.DataFrame({
        "measures": known.columns, "problem": ["", "", "no job topples"], "median": [49.0, 0.15, np.nan],
        "median_low": [2.0, 0.1, np.nan], "median_high": [8e80, 0.3, np.nan], "samples": [43, 50, np.nan],
        "samples_without_fit": [7, 0, np.nan],
    })  # fmt: skip
    table = Document().table(fit_table(summary, known), "fits")
    first, second, third = ([text for _, _, text in row] for row in table["rows"])
    assert "beyond 5 (2 to beyond 5)" in first
    assert {"43", "7"} <= {*first}
    assert "0.15 (0.1 to beyond 0.2)" in second
    assert "no job topples" in third


def test_fewer_than_ten_topplings_bear_no_curve_and_no_ranking(tmp_path):
    jobs = [
        job | {"toppled": number < 9}
        for number, job in enumerate(rows(records=12, levels=(4, 8), azimuths=(0.0,)))
    ]
    write_part(tmp_path, jobs)
    content, document = Content(open_run(tmp_path), 5), Document()
    (told,) = SECTIONS["Fits"](content, document)
    assert "Too few topplings: 9 of 24 jobs" in told
    assert (document.figures, document.tables) == (0, 0)
    assert content.statement is None


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("width_px", [1400, 400])
def test_nothing_on_the_page_is_clipped_or_sticks_out_of_the_screen(page, tmp_path, width_px):
    assert overflow(page, width_px, tmp_path) == []


@needs_browser
def test_the_check_of_the_layout_finds_what_sticks_out_and_what_is_clipped(tmp_path):
    wide = '<body><p style="width: 700px">wide</p><div style="width: 90px; overflow: hidden; white-space: nowrap">'
    found = overflow(wide + "words that are cut off at the end of their box</div></body>", 400, tmp_path)
    assert [word.partition(":")[0] for word in found] == ["outside", "clipped", "page scrolls sideways"]


@pytest.mark.slow
@needs_browser
def test_the_page_is_printed_on_eight_pages_at_most(page, tmp_path):
    written = write_pdf(page, tmp_path / "report.pdf").read_bytes()
    assert written.startswith(b"%PDF-")
    assert 5 <= len(re.findall(rb"/Type\s*/Page\b", written)) <= 8


def test_a_run_without_answers_has_no_page(tmp_path):
    write_part(tmp_path, [row("a", status="crashed")])
    with refused("run.no_answers"):
        report_page(Content(open_run(tmp_path)))
    assert CliRunner().invoke(cli, ["report", str(tmp_path)]).exit_code == 1
    assert not (tmp_path / "report.html").exists()


@pytest.mark.thorough
@pytest.mark.parametrize(("share", "beyond"), [(0.8, True), (3.0, False)])
def test_the_first_sentence_states_a_median_only_within_what_was_shaken(tmp_path, share, beyond):
    told = rows(records=40, azimuths=(0.0, 90.0, 180.0))
    write_part(tmp_path, [one for one in told if one["pgv_m_s"] < share * THETA_M_S])
    content = Content(open_run(tmp_path), samples=5)
    curve = content.chief.headline
    said = " ".join(first_screen(content, Document())["answers"])
    assert (curve.median > curve.strongest_shaken) == beyond
    assert ("beyond what was run" in said) == beyond
    assert (f"{curve.median:.2g}" in said) != beyond
