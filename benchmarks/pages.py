"""Tables that benchmarks put into pages of the docs."""

from pathlib import Path


def put(page: Path, name: str, text: str) -> None:
    """Replace what stands between the page's two comments of this name."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, rest = page.read_text().split(begin)
    page.write_text(f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}")


def table(rows: dict[str, dict[str, float]], first: str) -> str:
    """A table in Markdown of rows by name, with the name of its first column."""
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    lines = [f"| {first} | {' | '.join(columns)} |", "|---" * (1 + len(columns)) + "|"]
    lines += [
        f"| {name} | {' | '.join(f'{row[c]:.2f}' if c in row else '' for c in columns)} |"
        for name, row in rows.items()
    ]
    return "\n".join(lines)
