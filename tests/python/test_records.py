import json

import numpy
import pytest
from conftest import DEMO

import etalon

STUDY = f"""etalon: study/1
id: small
camera: {DEMO / "camera.yml"}
background: 0.6
white_level: 0.8
poses: {{count: 12, seed: 3, z_mm: [300, 500], roll_deg: [-30, 30], pitch_deg: [-30, 30]}}
detectors:
  - {{name: April, detector: apriltag, marker: "apriltag:36h11:5@50mm"}}
  - {{name: "Aru, co", detector: aruco, marker: "aruco:4X4_50:7@50mm"}}
"""


def test_a_study_is_columns(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    study = etalon.run_study(tmp_path / "study.yaml", tmp_path / "out", ablate=["noise"])
    results = study["results"]
    assert [one["name"] for one in study["detectors"]] == ["April", "Aru, co"] and study["poses"] == 12
    assert len(results["pose"]) == 12 * 2 * 2
    assert set(results["detector"]) == {"April", "Aru, co"} and set(results["variant"]) == {"as is", "noise"}
    found = results["detected"] == 1
    assert found.mean() > 0.8 and results["failure"].dtype.kind == "U"
    assert ((results["z_mm"] >= 300) & (results["z_mm"] <= 500)).all()
    # distance is the length of the error, by its own columns.
    length = numpy.sqrt(sum(results[f"{axis}_error_mm"] ** 2 for axis in "xyz"))
    assert numpy.nanmax(numpy.abs(length - results["distance_mm"])[found]) < 1e-5  # of six digits
    own = (results["variant"] == "as is") & (results["detector"] == "April") & found
    summary, row = study["summary"], True
    for column, word in {"variant": "as is", "detector": "April", "set": "own", "measure": "Z"}.items():
        row = row & (summary[column] == word)
    assert abs(summary["mean"][row][0] - results["z_error_mm"][own].mean()) < 1e-3
    assert etalon.read_results(tmp_path / "out")["id"] == "small"


def test_a_table_has_a_type_for_each_column(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("pose,split,x_mm,word\n1,training,,nan\n2,,-7.5e1,5\n")
    table = etalon.read_table(path, text=("split",))
    assert table["pose"].tolist() == [1, 2] and table["split"].tolist() == ["training", ""]
    assert numpy.isnan(table["x_mm"][0]) and table["x_mm"][1] == -75
    assert table["word"].tolist() == ["nan", "5"]  # a word, not a number that is missing


@pytest.mark.parametrize(
    "text, line", [("", 1), ("a,a\n1,2\n", 1), ("a,b\n1,2\n3\n", 3), ("a,b\n1,2,3\n", 2)]
)
def test_a_damaged_table_says_where(tmp_path, text, line):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(etalon.ConfigError) as caught:
        etalon.read_table(path)
    assert (caught.value.file, caught.value.line) == (str(path), line)


def test_a_damaged_record_is_refused(tmp_path):
    with pytest.raises(etalon.ConfigError, match="run.json"):
        etalon.read_record(tmp_path)
    for content in ("{", "[]", json.dumps({"etalon": "run/9"}), '{"etalon": "run/1", "a": NaN}'):
        (tmp_path / "run.json").write_text(content)
        (tmp_path / "poses.csv").write_text("pose\n1\n")
        with pytest.raises(etalon.ConfigError, match="run.json"):
            etalon.read_record(tmp_path)
    (tmp_path / "run.json").write_bytes(b'\xff{"etalon": "run/1"}')
    with pytest.raises(etalon.ConfigError, match="run.json"):
        etalon.read_record(tmp_path)
