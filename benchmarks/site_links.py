"""The site's pages stand beside the reports, which the checkout has in another folder: a hook of mkdocs."""

from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with links between docs/ and benchmarks/reports/ as the site lays them out."""
    return markdown.replace("../benchmarks/reports/", "reports/").replace("../../docs/", "../")
