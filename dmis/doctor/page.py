"""The doctor's report as a page for a browser, which needs no network."""

from __future__ import annotations

from html import escape

from dmis.doctor.diagnosis import Diagnosis

SHOWN = 60
"""Tests of parts of the rows, those of the largest z."""
SCALE = 12.0
"""Pixels of a bar for each standard error."""
STYLE = "body{font:15px sans-serif;max-width:60em;margin:2em auto}td,th{padding:2px 9px;text-align:left}"
STYLE += "pre{white-space:pre-wrap}.bad{background:#c33}.ok{background:#693}.few{background:#aaa}"


def page(diagnosis: Diagnosis, name: str) -> str:
    """Return the HTML of a diagnosis: its text, and a bar of z for each test; `name` is the table's."""
    rows = []
    for test in diagnosis.largest(SHOWN):
        kind = "few" if not test.trusted else "bad" if abs(test.z) > diagnosis.limit else "ok"
        width = min(300.0, SCALE * abs(test.z))
        bar = f'<div class="{kind}" style="width:{width:.0f}px;height:10px"></div>'
        cells = (test.name, test.where, f"{test.difference:+.2%}", f"{test.z:+.1f}", f"{test.rows:,}")
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + f"<td>{bar}</td></tr>")
    head = "".join(f"<th>{title}</th>" for title in ("test", "rows", "difference", "z", "number", "abs(z)"))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(name)}</title><style>{STYLE}</style>'
        f"<h1>{escape(name)}</h1><pre>{escape(diagnosis.text())}</pre>"
        f"<table><tr>{head}</tr>{''.join(rows)}</table></html>\n"
    )
