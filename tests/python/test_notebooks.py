"""Every notebook of examples/notebooks runs and draws; the code of docs/python.md runs."""

import re
import runpy
import shutil

import pytest
from conftest import ROOT

import etalon

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.py"))


def test_there_are_notebooks():
    assert len(NOTEBOOKS) == 4


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path, monkeypatch):
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
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(), re.DOTALL)


def test_the_first_example_of_the_page_runs(page, capsys):
    exec(page[0], {})
    assert "True" in capsys.readouterr().out


@pytest.mark.skipif(not hasattr(etalon._etalon, "_Twin"), reason="this build has no twin: Aravis is missing")
def test_the_examples_with_devices_run(page, capsys, tmp_path):
    with etalon.twin():
        exec("import etalon\n" + page[1], {})
    assert capsys.readouterr().out.count("[") == 5  # a matrix
    (tmp_path / "test_own.py").write_text(page[2])
    assert pytest.main(["-q", "-p", "no:cacheprovider", str(tmp_path / "test_own.py")]) == 0
