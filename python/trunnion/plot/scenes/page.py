"""A page of views that works without a network: Plotly's script is in it."""

from __future__ import annotations

import html
from collections.abc import Sequence
from string import Template
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'
 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="trunnion">
<title>$title</title>
<style>
:root { color-scheme: light dark; }
body { font-family: system-ui, sans-serif; margin: 1rem auto; max-width: 75rem; padding: 0 1rem;
       background: light-dark(#fff, #16181d); color: light-dark(#1a1a1a, #e8e8e8); }
h1 { font-size: 1.3rem; } figure { margin: 1rem 0; } figcaption { font-size: .9rem; }
</style>
</head>
<body>
<main>
<h1>$title</h1>
$body
</main>
</body>
</html>
""")
CONFIG = {"displaylogo": False, "responsive": True}


def views_page(views: Sequence[tuple[str, Figure]], title: str) -> str:
    """Return one self-contained page with views, each under its name.

    views: (name, Plotly figure). All names and the title are escaped.
    """
    body = []
    for number, (name, figure) in enumerate(views):
        drawn = figure.to_html(
            full_html=False, include_plotlyjs=number == 0, config=CONFIG, div_id=f"view{number}"
        )
        label = html.escape(name, quote=True)
        caption = f"<figcaption>{html.escape(name)}: drag to turn, wheel to zoom</figcaption>"
        body.append(f'<figure aria-label="{label}">{drawn}{caption}</figure>')
    return _PAGE.substitute(title=html.escape(title), body="\n".join(body))
