# SPDX-License-Identifier: LGPL-3.0-or-later
"""The demos as pages: their text and code, the figures they draw, the command that runs them.

Demos are scripts in jupytext's light format. They are not run when the documentation is built:
some take an hour. The figures are those in `docs/`, which `gallery.py` draws again.
"""

from pathlib import Path

import jupytext
from gallery import GALLERY

_INDEX = """# Demos

Each demo is a script to run, to read and to change: text and code below are the script's own, the
figures what it draws. Options are said by `--help`; results go to `results/NAME`, or `--out`.

```{toctree}
:maxdepth: 1

%s
```
"""


def page_of(script: Path) -> str:
    """A demo as MyST Markdown.

    Args:
        script: the demo.
    """
    cells = jupytext.read(script).cells
    first = next(i for i, cell in enumerate(cells) if cell.source.startswith("# "))
    title, _, introduction = cells[first].source.partition("\n")
    text = f"{title}\n{introduction}\n\n"
    made = [figures for figures in GALLERY if figures.demo == script.stem]
    commands = [figures.command(figures.folder) for figures in made]
    text += "```sh\n" + "\n".join(commands) + "\n```\n\n"
    for figures in made:
        for file, caption in zip(figures.files, figures.captions, strict=True):
            text += f":::{{figure}} ../{file}\n:alt: {caption}\n\n{caption}.\n:::\n\n"
    for cell in cells[first + 1 :]:
        fence = "```python\n{}\n```\n\n" if cell.cell_type == "code" else "{}\n\n"
        text += fence.format(cell.source)
    return text


def write_demos(demos: Path, pages: Path) -> None:
    """Write a page for each demo, and their index.

    Args:
        demos: folder of the scripts.
        pages: folder to write into.
    """
    pages.mkdir(exist_ok=True)
    scripts = sorted(demos.glob("*.py"))
    texts = {script.stem: page_of(script) for script in scripts}
    texts["index"] = _INDEX % "\n".join(script.stem for script in scripts)
    for name, text in texts.items():
        page = pages / f"{name}.md"
        if not page.exists() or page.read_text() != text:
            page.write_text(text)
