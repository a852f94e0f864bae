# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs the Python code of pages, each in the folder of its page, where its pictures go.

./fenicsx python3 docs/run_page.py docs/tutorials/cracked_plate.md
"""

import argparse
import os
import re
from pathlib import Path


def main() -> None:
    """Run the pages named."""
    parser = argparse.ArgumentParser(description="Run the Python code of pages.")
    parser.add_argument("pages", type=Path, nargs="+", help="Markdown files")
    pages = [page.resolve() for page in parser.parse_args().pages]
    for page in pages:
        text = page.read_text()
        names = {"__name__": "__main__"}
        os.chdir(page.parent)
        for number, code in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL), 1):
            exec(compile(code, f"{page.name}, block {number}", "exec"), names)


if __name__ == "__main__":
    main()
