"""The report as one HTML page that opens from disk: plots inline, pictures inside, nothing fetched."""

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

from garment_jax.bench.tables import OPEN, Table

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #26292e; max-width: 1180px;
  margin: 2em auto; padding: 0 1.5em }
h1 { font-size: 1.7em; margin-bottom: .2em } h2 { font-size: 1.2em; margin: 2em 0 .5em }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums }
th, td { padding: .28em .7em; text-align: right; border-bottom: 1px solid #e4e6ea; white-space: nowrap }
th { border-bottom: 2px solid #9aa1ab; vertical-align: bottom; white-space: normal }
th:first-child, td:first-child { text-align: left }
tbody tr:hover { background: #f5f6f8 } td.open { color: #a9afb8 }
div.wide { overflow-x: auto } p.note, p.facts { color: #747a82; font-size: 13px; max-width: 75em }
svg { width: 100%; max-width: 1000px; height: auto } img { max-width: 100%; height: auto }
""".strip()


def make_page(
    title: str,
    facts: str,
    plots: Mapping[str, str],
    pictures: Mapping[str, Path],
    tables: Sequence[Table],
    notes: Mapping[str, str],
) -> str:
    """Return the page: `plots` title -> SVG, `pictures` title -> PNG file, `notes` title -> a sentence."""
    parts = [f"<h1>{html.escape(title)}</h1>", f'<p class="facts">{html.escape(facts)}</p>']
    first, *rest = plots.items()
    parts.append(_section(*first, notes))
    parts += [table_html(table) for table in tables[:1]]
    parts += [_section(name, svg, notes) for name, svg in rest]
    parts += [table_html(table) for table in tables[1:]]
    parts += [_section(name, _image(path), notes) for name, path in pictures.items()]
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>\n'
        f"<style>\n{STYLE}\n</style></head><body>\n{body}\n</body></html>\n"
    )


def _section(name: str, content: str, notes: Mapping[str, str]) -> str:
    note = f'<p class="note">{html.escape(notes[name])}</p>' if name in notes else ""
    return f"<h2>{html.escape(name)}</h2>\n<figure style='margin:0'>{content}</figure>{note}"


def _image(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{html.escape(path.stem)}" src="data:image/png;base64,{data}">'


def table_html(table: Table) -> str:
    """Return a table as HTML with its heading and note."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.head)
    body = "\n".join("<tr>" + "".join(_td(cell) for cell in row) + "</tr>" for row in table.rows)
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return (
        f'<h2>{html.escape(table.title)}</h2>\n<div class="wide"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>{note}"
    )


def _td(cell: str) -> str:
    return f'<td class="open">{cell}</td>' if cell == OPEN else f"<td>{html.escape(cell)}</td>"
