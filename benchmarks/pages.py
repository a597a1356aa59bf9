"""Tables that benchmarks put into pages of the docs."""

from pathlib import Path


def put(page: Path, name: str, text: str) -> None:
    """Replace what stands between the page's two comments of this name."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, rest = page.read_text().split(begin)
    page.write_text(f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}")
