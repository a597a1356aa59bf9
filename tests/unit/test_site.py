"""The site of the documentation builds without a warning, and asks no other host for anything."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import toppling

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_documents_every_name_at_the_door(tmp_path):
    subprocess.run(["make", "--silent", "packages"], cwd=ROOT, check=True)
    build = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(tmp_path / "site"),
    ]
    done = subprocess.run(
        build,
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    pages = {path.name: path.read_text() for path in (tmp_path / "site").rglob("*.html")}
    for name in set(toppling.__all__):
        assert re.search(rf'id="toppling\.[\w.]*\.{name}"', pages["reference.html"]), name
    loaded = {
        host
        for page in pages.values()
        for host in re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="https?://([^/"]+)', page)
    }
    assert loaded == set()


def test_every_page_of_the_documentation_is_in_the_site():
    listed = (ROOT / "mkdocs.yml").read_text()
    for page in (ROOT / "docs").rglob("*.md"):
        assert str(page.relative_to(ROOT / "docs")) in listed, page
