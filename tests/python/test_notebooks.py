"""Every notebook of examples/notebooks runs and draws; the code of docs/python.md and README.md runs; all of it
passes mypy --strict.
"""

import re
import runpy
import shutil
from pathlib import Path

import pytest
from conftest import DEMO, ROOT, exposed, pose

import etalon

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.py"))


def test_there_are_notebooks():
    assert len(NOTEBOOKS) == 4


def blocks(page):
    """Its code; a block without an import goes on from the one before."""
    found = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
    return [block if re.search("^import .*etalon", block, re.M) else "import etalon\n" + block for block in found]


CODE = {
    **{notebook.stem: notebook.read_text() for notebook in NOTEBOOKS},
    **{f"{page}-{i}": code for page in ("README.md", "docs/python.md") for i, code in enumerate(blocks(page))},
}


@pytest.mark.parametrize("name", CODE)
def test_the_code_of_the_documents_passes_mypy_strict(name, tmp_path, monkeypatch):
    mypy = pytest.importorskip("mypy.api", reason="mypy is missing")
    monkeypatch.setenv("MYPYPATH", str(Path(etalon.__file__).parents[1]))
    (tmp_path / "code.py").write_text(CODE[name])
    options = ["--strict", "--ignore-missing-imports", "--follow-imports=silent", f"--cache-dir={tmp_path}"]
    told, trouble, _ = mypy.run([*options, str(tmp_path / "code.py")])
    assert told.startswith("Success"), told + trouble


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    if notebook.stem == "bias_field" and not hasattr(etalon._etalon, "_Twin"):
        pytest.skip("this build has no twin: Aravis is missing")
    monkeypatch.chdir(tmp_path)
    assert notebook.read_text().startswith("# %% [markdown]\n")
    runpy.run_path(str(notebook))
    pictures = list(tmp_path.glob("*.png"))
    assert pictures and all(picture.stat().st_size > 5000 for picture in pictures)
    shutil.rmtree(tmp_path)


@pytest.fixture
def page(tmp_path, monkeypatch):
    """The page's blocks of Python, where the examples are."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return blocks("docs/python.md")


def test_the_first_example_of_the_page_runs(page, capsys):
    exec(page[0], {})
    assert "True" in capsys.readouterr().out


def test_the_example_of_the_readme_runs(camera, tag, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(DEMO / "camera.yml", "left.yml")
    etalon.write_image("tag.png", exposed(camera, [(tag, pose(0.35, -0.2, 0.1, 20, -10, 420))]))
    exec(blocks("README.md")[0], {})
    assert capsys.readouterr().out.count("[") == 5  # a matrix


@pytest.mark.skipif(not hasattr(etalon._etalon, "_Twin"), reason="this build has no twin: Aravis is missing")
def test_the_examples_with_devices_run(page, capsys, tmp_path):
    with etalon.twin():
        exec(page[1], {})
    assert capsys.readouterr().out.count("[") == 5  # a matrix
    (tmp_path / "test_own.py").write_text(page[2])
    assert pytest.main(["-q", "-p", "no:cacheprovider", str(tmp_path / "test_own.py")]) == 0
