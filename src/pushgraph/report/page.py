"""The page: Markdown, and the same as one HTML file that holds its pictures."""

import base64
import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

from pushgraph.report.tables import Table
from pushgraph.storage import replacing

STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8881; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2, h3 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid var(--line); padding-top: 1rem; }
table { border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; font-size: 0.9rem; }
th, td { border-bottom: 1px solid var(--line); padding: 0.25rem 0.75rem; text-align: left; white-space: nowrap; }
th { background: var(--soft); } code { background: var(--soft); padding: 0.1rem 0.3rem; overflow-wrap: anywhere; }
img { max-width: 100%; background: white; }
blockquote { border-left: 4px solid var(--line); margin-left: 0; padding-left: 1rem; }
"""


@dataclass(frozen=True)
class Picture:
    """A figure's file, and what it shows."""

    path: Path
    title: str


@dataclass(frozen=True)
class Section:
    """One experiment. text: paragraphs of Markdown."""

    title: str
    text: Sequence[str]
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()


def markdown(title: str, introduction: Sequence[str], sections: Sequence[Section], folder: Path) -> str:
    """The page as Markdown that lies in `folder`; pictures are named relative to it."""
    blocks = [f"# {title}", *introduction]
    for section in sections:
        blocks += [f"## {section.title}", *section.text]
        for table in section.tables:
            blocks += [f"**{table.title}**", lines_of(table)]
        for picture in section.pictures:
            blocks.append(f"![{picture.title}]({os.path.relpath(picture.path, folder)})")
    return "\n\n".join(blocks) + "\n"


def save_page(text: str, folder: Path, name: str = "report") -> tuple[Path, Path]:
    """Write Markdown with this text and one HTML file that needs no other; returns both paths."""
    paths = folder / f"{name}.md", folder / f"{name}.html"
    for path, content in zip(paths, (text, _html(text, folder)), strict=True):
        with replacing(path) as temporary:
            temporary.write_text(content, encoding="utf-8")
    return paths


def lines_of(table: Table) -> str:
    """A table as Markdown, without its title."""
    lines = [table.head, ("---",) * len(table.head), *table.cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _html(text: str, folder: Path) -> str:
    parser = MarkdownIt("commonmark").enable("table")
    tokens = parser.parse(text)
    for image in (child for token in tokens for child in token.children or () if child.type == "image"):
        picture = base64.b64encode((folder / str(image.attrs["src"])).read_bytes()).decode()
        image.attrs["src"] = f"data:image/png;base64,{picture}"
    body = parser.renderer.render(tokens, parser.options, {})
    title = html.escape(text.splitlines()[0].removeprefix("# "))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>\n'
        f"<body>\n{body}</body></html>\n"
    )
