#!/usr/bin/env python3
"""Runs notebooks that are text (`# %%` begins a cell) and writes each as a page of the documentation:
its cells, what they printed and the pictures they saved.

    notebook_pages.py FOLDER NOTEBOOK...      FOLDER/render_and_detect.md and its pictures
"""
import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path


def cells_of(text):
    """(is markdown, text) of each cell."""
    for part in re.split(r"^# %%", text, flags=re.MULTILINE)[1:]:
        kind, _, body = part.partition("\n")
        if "[markdown]" in kind:
            yield True, re.sub(r"^# ?", "", body, flags=re.MULTILINE).strip()
        else:
            yield False, body.strip()


def run_cell(code, names):
    """What it printed, and the pictures that it left in the current folder."""
    before = set(Path().glob("*.png"))
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "cell", "exec"), names)
    return printed.getvalue().rstrip(), sorted(set(Path().glob("*.png")) - before)


def page_of(notebook, folder):
    names = {"__name__": "__main__", "__file__": str(notebook)}
    lines = []
    for is_markdown, text in cells_of(notebook.read_text()):
        if is_markdown:
            lines += [text, ""]
            continue
        lines += ["```python", text, "```", ""]
        printed, pictures = run_cell(text, names)
        if printed:
            lines += ["```text", printed, "```", ""]
        for picture in pictures:
            shutil.copy(picture, folder)
            lines += [f"![What the cell plots]({picture.name})", ""]
    return "\n".join(lines)


def main():
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for notebook in [Path(name).resolve() for name in sys.argv[2:]]:
        with tempfile.TemporaryDirectory() as scratch:
            os.chdir(scratch)
            (folder / f"{notebook.stem}.md").write_text(page_of(notebook, folder))
            os.chdir(folder)


if __name__ == "__main__":
    main()
