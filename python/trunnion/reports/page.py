"""A document as one HTML page that needs no network: style, script and pictures are in it.

Everything that is not written here is escaped: titles, sentences and cells may come from files.
"""

from __future__ import annotations

import html
import json
import re
from importlib.resources import files
from itertools import groupby
from string import Template
from typing import Any

from trunnion.base.conformity import Decision
from trunnion.base.report import Cell, Table
from trunnion.plot.image import still
from trunnion.plot.picture import Kind, Picture
from trunnion.reports.document import Document, Interactive, Item, Listing, Points, Section

MIN_SORTED = 3  # rows, from which a table can be sorted
TOP_WIDTH = 480  # pixels of a picture beside the results
SHORT_TABLE = 16  # rows: it is not broken on paper
SHORT = 25  # characters of a first column that does not wrap
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:"
)
"""The page itself forbids every connection."""

_QUANTITY = re.compile(
    r"(?:&[lg]t; )?[+−]?\d[\d.]*(?: ± [\d.]+)? (?:%|[µ°][\w/°]*|arcsec|ppm|mm|s\b)"
    r"|\(k = 2\)"
)
_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="$policy">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="trunnion">
<meta name="color-scheme" content="light dark">
<title>$title</title>
<style>
$style
@page { @bottom-left { content: "$foot"; } }
</style>
</head>
<body>
<main>
$body
</main>
$scripts
</body>
</html>
""")


class _Writer:
    """Writes the items of a document and collects its interactive pictures."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.figures: list[dict[str, Any]] = []
        self.rows: dict[int, str] = {}

    def body(self) -> str:
        """Return heading, verdict, results, sections."""
        d = self.document
        under = f'<p class="subtitle">{html.escape(d.subtitle)}</p>' if d.subtitle else ""
        verdict = f'<p class="verdict {d.mark}"><strong>Result</strong> {_escaped(d.verdict)}</p>'
        parts = [
            f"<header><h1>{html.escape(d.title)}</h1>{under}{verdict}</header>",
            self._top(d.top),
            *(self._section(s) for s in d.sections if s.items),
        ]
        return "\n".join(parts)

    def _section(self, section: Section) -> str:
        inner = self._items(section.items)
        return f"<section><h2>{html.escape(section.title)}</h2>\n{inner}\n</section>"

    def _top(self, items: tuple[Item, ...]) -> str:
        """Return what people came for: words and tables, beside them the pictures."""
        shown = [item for item in items if _drawn(item)]
        said = self._items(tuple(item for item in items if not _drawn(item)))
        if not shown:
            return said
        pictures = self._items(tuple(shown), at_once=True)
        return f'<div class="top"><div>{said}</div><div>{pictures}</div></div>'

    def _items(self, items: tuple[Item, ...], *, at_once: bool = False) -> str:
        """Return items, pictures that follow each other side by side."""
        parts = []
        for drawn, group in groupby(items, _drawn):
            inner = "\n".join(self.item(item, at_once=at_once) for item in group)
            parts.append(f'<div class="pair">{inner}</div>' if drawn else inner)
        return "\n".join(parts)

    def item(self, item: Item, *, at_once: bool = False) -> str:
        """Return one item as HTML; at_once: A picture is seen before the script has run."""
        match item:
            case str():
                return f"<p>{_escaped(item)}</p>"
            case Table():
                return table(item)
            case Listing():
                return f"<pre>{html.escape(item.text)}</pre>"
            case Points():
                rows = "".join(f"<li>{_escaped(one)}</li>" for one in item.sentences)
                head = f'<h2 class="small">{html.escape(item.title)}</h2>' if item.title else ""
                return f"{head}<ul>{rows}</ul>"
        return self._figure(item, at_once=at_once)

    def _figure(self, picture: Interactive, *, at_once: bool) -> str:
        number, height, seen = len(self.figures), _height(picture), ""
        if isinstance(picture, Picture):
            if at_once:
                seen = still(picture, TOP_WIDTH, height, f"figure {number}")
            picture = picture.thinned()
        self.figures.append(self._shared(picture.to_plotly()))
        note = f'<p class="note">{_escaped(picture.note)}</p>' if picture.note else ""
        key = getattr(picture, "key", "")
        mine = self.document.groups.get(key)
        button = (
            f'<button type="button" data-group="{html.escape(key)}" aria-pressed="false" '
            f'aria-label="highlight its readings: {html.escape(mine.label)}">'
            "highlight its readings</button>"
            if mine is not None
            else ""
        )
        alt = html.escape(picture.description)
        kind = "" if isinstance(picture, Picture) else ' class="wide"'
        return (
            f'<figure{kind}><figcaption id="caption{number}">{_escaped(picture.title)}{button}'
            f'</figcaption><div class="plot" style="height:{height}px" data-figure="{number}">'
            f"{seen}</div>"
            f'<p class="described">{alt}</p>{note}</figure>'
        )

    def _shared(self, figure: dict[str, Any]) -> dict[str, Any]:
        """Keep what stands beside a row once a page: a picture has the last line of each alone."""
        for trace in figure["data"]:
            rows, texts = trace.get("customdata"), trace.get("text")
            if not (isinstance(rows, list) and isinstance(texts, list)):
                continue
            parts = [text.rpartition("<br>") for text in texts]
            pairs = list(zip(rows, (head for head, _, _ in parts), strict=True))
            if all(self.rows.get(row, head) == head for row, head in pairs):
                self.rows.update(pairs)
                trace["text"], trace["meta"] = [tail for _, _, tail in parts], "rows"
        return figure

    def scripts(self) -> str:
        """Return the pictures, the library that draws them, and the script of the page."""
        own = _asset("report.js")
        groups = {k: [g.rows.tolist()] for k, g in self.document.groups.items()}
        data = _json({"figures": self.figures, "groups": groups, "rows": self.rows})
        parts = [f'<script type="application/json" id="report-data">{data}</script>']
        if self.figures:
            from plotly.offline import get_plotlyjs

            # Not run before the page has been seen.
            parts.append(f'<script type="text/plain" id="library">{get_plotlyjs()}</script>')
        return "\n".join([*parts, f"<script>{own}</script>"])


def _escaped(text: str) -> str:
    """Return a text as HTML, whose numbers stay beside their units."""
    return _QUANTITY.sub(r'<span class="whole">\g<0></span>', html.escape(text))


def _drawn(item: Item) -> bool:
    """Whether an item is a picture."""
    return not isinstance(item, str | Table | Listing | Points)


def _height(picture: Interactive) -> int:
    """Height in pixels: of bars by their number, of maps and polar plots as wide as high."""
    if not isinstance(picture, Picture):
        return 520
    if picture.kind is not Kind.CARTESIAN:
        return 500
    return 110 + 34 * len(picture.y.names) if picture.y.names else 340


def page(document: Document) -> str:
    """Return a document as the text of an HTML page."""
    writer = _Writer(document)
    body = writer.body()
    return _PAGE.substitute(
        policy=POLICY,
        title=html.escape(document.title),
        style=_asset("report.css"),
        foot=_in_css(" · ".join(filter(None, (document.title, document.subtitle)))),
        body=body,
        scripts=writer.scripts(),
    )


def _in_css(text: str) -> str:
    """Return a text as part of a string in a style: all but plain letters as their code."""
    return "".join(c if c.isascii() and c.isalnum() else f"\\{ord(c):x} " for c in text)


def table(of: Table) -> str:
    """Return a table: headings that sort it, numbers with the value that they are sorted by."""
    if not of.rows:
        return ""
    sorts = len(of.rows) >= MIN_SORTED
    texts = of.cells()
    # A column of numbers is set flush right.
    numeric = [
        index > 0 and any(isinstance(row[index], float | int) for row in of.rows)
        for index in range(len(of.columns))
    ]
    head = "".join(
        _heading(name or "item", "num" if number else "", sorts=sorts)
        for name, number in zip(of.columns, numeric, strict=True)
    )
    body = "".join(
        f"<tr>{''.join(map(_cell, row, shown, numeric, range(len(row))))}</tr>"
        for row, shown in zip(of.rows, texts, strict=True)
    )
    title, short = html.escape(of.title), " short" if len(of.rows) <= SHORT_TABLE else ""
    return (
        f'<div class="scroll{short}" tabindex="0" role="region" aria-label="{title}"><table>'
        f"<caption>{title}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
        "</table></div>"
    )


def _heading(name: str, kind: str, *, sorts: bool) -> str:
    text = _escaped(name)
    inner = f'<button type="button" class="sort">{text}</button>' if sorts else text
    return f'<th scope="col" class="{kind}">{inner}</th>'


def _cell(value: Cell, text: str, numeric: bool, place: int) -> str:
    shown = _escaped(text)
    if text in tuple(Decision):
        shown = f'<span class="badge {text}">{shown}</span>'
    if place == 0:
        whole = ' class="whole"' if len(text) <= SHORT else ""
        return f'<th scope="row"{whole}>{shown}</th>'
    key = f' data-value="{float(value):.9g}"' if isinstance(value, float | int) else ""
    kind = " class=num" if numeric else " class=long" if len(text) > SHORT else ""
    return f"<td{kind}{key}>{shown}</td>"


def _json(value: Any) -> str:
    """Return JSON that cannot end the script that it stands in."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _asset(name: str) -> str:
    return files("trunnion.reports").joinpath(name).read_text(encoding="utf-8")
