"""Tables in HTML, LaTeX, Markdown and their like, as text with tabs between cells."""

import html
import re
from collections.abc import Callable, Iterable

_LOOKED_AT = 20_000
"""Characters of a text among which the signs of a table are looked for."""
_HTML = re.compile(r"<t[dh]\b", re.IGNORECASE)
_HTML_UNSEEN = re.compile(r"<!--.*?(?:-->|\Z)|<(script|style)\b.*?(?:</\1\s*>|\Z)", re.IGNORECASE | re.DOTALL)
"""What is left open goes to the end, as in a browser: each place of a damaged file is looked at once."""
_HTML_ROW = re.compile(r"</?(?:tr|table|caption|p|div|h\d|br|li)\b[^<>]*>", re.IGNORECASE)
_LATEX = re.compile(r"\\begin\{(?:long)?tab[a-z]*\*?\}|\\begin\{array\}")
_BRACES = r"\{(?:[^{}]|\{[^{}]*\})*\}"
_LATEX_BREAK = re.compile(
    rf"\\begin\{{[^{{}}]*\}}(?:\[[^][]*\])?(?:{_BRACES})*|\\end\{{[^{{}}]*\}}|\\\\(?:\[[^][]*\])?"
)
_LATEX_RULE = re.compile(rf"\\(?:c?mid|top|bottom|h|c)(?:rule|line)(?:\([^()]*\))?(?:{_BRACES})?|(?<!\\)%.*")
_LATEX_SIGNS = (
    (r"\times", "×"),
    (r"\cdot", "·"),
    (r"\pm", "±"),
    (r"\%", "%"),
    (r"\_", "_"),
    (r"\,", " "),
    ("~", " "),
)
_LATEX_WRAP = re.compile(
    r"\\multicolumn\{[^{}]*\}\{[^{}]*\}\{([^{}]*)\}|\\[a-zA-Z]+\{([^{}]*)\}|\{([^{}]*)\}"
)
_WIKI = re.compile(r"^[ \t]*\{\|.*$\n", re.MULTILINE)
_WIKI_ROW = re.compile(r"^[ \t]*\|(?:-.*|\+.*|\})$", re.MULTILINE)
_WIKI_CELL = re.compile(r"^[ \t]*[|!]|\|\||!!", re.MULTILINE)
"""Of MediaWiki: what opens a table, parts its rows, and begins a cell."""
_WIKI_LOOK = re.compile(r"=\s*\"")
"""Before the bar in a cell: how it is to look."""
_PIPE_RULE = re.compile(r"(?=.*[|+])[\s|+:]*(?:--|==)[\s|+:=-]*")
"""Of a table with pipes, below the names or between rows."""
_BLANK_RULE = re.compile(r"\s*={2,}(?:\s+={2,})+\s*")
"""Of a simple table of reStructuredText."""


def table_text(text: str) -> str:
    """Text with tabs between the cells of its tables, in whichever of these markups it is; other text as it is.

    Examples
    --------
    >>> table_text("<tr><th>PGA (g)<th>annual_rate<tr><td>0.1<td>10<sup>-3</sup>").split("\\n")
    ['', 'PGA (g)\\tannual_rate', '0.1\\t10^-3']
    >>> table_text("| **PGA (g)** | annual_rate |\\n|---|---|\\n| 0.1 | 1e-3 |").split("\\n")
    ['PGA (g)\\tannual_rate', '', '0.1\\t1e-3']
    >>> table_text('{| class="wikitable"\\n! PGA (g) !! annual_rate\\n|-\\n| 0.1\\n| 1e-3\\n|}').split("\\n")
    ['PGA (g)\\tannual_rate', '0.1\\t1e-3', '']
    """
    head = text[:_LOOKED_AT]
    if _HTML.search(head):
        return _of_html(text)
    if _LATEX.search(head):
        return _of_latex(text)
    if _WIKI.search(head):
        return "\n".join(map(_wiki_row, _WIKI_ROW.split(_WIKI.sub("", text))))
    if "|" in head and any(map(_PIPE_RULE.fullmatch, head.splitlines())):
        return _joined(text.splitlines(), _pipe_cells)
    if "==" in head and any(map(_BLANK_RULE.fullmatch, head.splitlines())):
        return "\n".join("" if _BLANK_RULE.fullmatch(line) else line for line in text.splitlines())
    return text


def _of_html(text: str) -> str:
    text = re.sub(r"\s+", " ", _HTML_UNSEEN.sub("", text))
    text = re.sub(r"<sup\b[^<>]*>", "^", _HTML_ROW.sub("\n", text), flags=re.IGNORECASE)
    text = re.sub(r" *<t[dh]\b[^<>]*> *", "\t", text, flags=re.IGNORECASE)
    text = html.unescape(re.sub(r"<[^<>]*>", "", text)).replace("\u00a0", " ")
    return _joined(text.split("\n"), lambda line: line.strip(" ").removeprefix("\t").split("\t"))


def _of_latex(text: str) -> str:
    text = _LATEX_BREAK.sub("\n\n", _LATEX_RULE.sub("", text)).replace(r"\&", "and").replace("$", "")
    for sign, plain in _LATEX_SIGNS:
        text = text.replace(sign, plain)
    text = re.sub(r"(?<!\n)\n(?!\n)", " ", text)  # rows end in two backslashes
    for _ in range(4):  # commands within commands
        text = _LATEX_WRAP.sub(lambda found: next(filter(None, found.groups()), ""), text)
    text = re.sub(r"\\[a-zA-Z]+\*? ?", "", text)
    return _joined(filter(str.strip, text.split("\n")), lambda line: line.split("&"))


def _wiki_row(row: str) -> str:
    return "\t".join(_wiki_cell(cell).strip().strip("'") for cell in _WIKI_CELL.split(row)[1:])


def _wiki_cell(cell: str) -> str:
    look, bar, seen = cell.partition("|")
    return seen if bar and "\n" not in look and _WIKI_LOOK.search(look) else cell


def _pipe_cells(line: str) -> list[str]:
    inside = line.strip().removeprefix("|").removesuffix("|")
    return [] if _PIPE_RULE.fullmatch(line) else [cell.strip().strip("*`") for cell in inside.split("|")]


def _joined(lines: Iterable[str], cells: Callable[[str], list[str]]) -> str:
    return "\n".join("\t".join(cell.strip() for cell in cells(line)) for line in lines)
