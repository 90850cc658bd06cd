"""Records and studies as dicts of numpy arrays, one for each column: what pandas.DataFrame() takes."""

import csv
import json
import os
from pathlib import Path

import numpy

from etalon.errors import ConfigError


def path_of(given, name):
    """A Path of an argument, which a TypeError names where it is none."""
    if not isinstance(given, (str, os.PathLike)):
        raise TypeError(f"{name}: must be a path, is {type(given).__name__}")
    return Path(given)


def _text(path):
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # a zero in the name is a ValueError
        raise ConfigError(f"{path}: {error}", str(path)) from None


def _number(cell):
    return float(cell) if cell.strip() else numpy.nan


def _column(cells):
    try:
        numbers = numpy.array([_number(cell) for cell in cells], dtype=float)
    except ValueError:
        return numpy.array(cells, dtype=str)
    if any(cell.strip() and not numpy.isfinite(number) for cell, number in zip(cells, numbers)):
        return numpy.array(cells, dtype=str)  # a word that float() would take: "nan", "infinity"
    return numbers


def read_table(path, text=()):
    """The columns of a CSV file that etalon wrote, by name: float64, NaN where a cell is empty, or str.

    text: names of columns that are str whatever they hold. Raises ConfigError with file and line.
    """
    path = path_of(path, "path")
    if not isinstance(text, (list, tuple, set)) or not all(isinstance(name, str) for name in text):
        raise TypeError(f"text: must be a list of columns' names, is {type(text).__name__}")
    rows = csv.reader(_text(path).splitlines())
    header = next(rows, None)
    if not header or len(set(header)) != len(header):
        raise ConfigError(f"{path}:1: needs a header of different names", str(path), 1)
    cells = []
    for row in rows:
        if len(row) != len(header):
            message = f"{path}:{rows.line_num}: has {len(row)} cells, its header {len(header)}"
            raise ConfigError(message, str(path), rows.line_num)
        cells.append(row)
    columns = zip(*cells) if cells else [()] * len(header)
    return {
        name: numpy.array(column, dtype=str) if name in text else _column(column)
        for name, column in zip(header, columns)
    }


def _json(path, kind):
    def refuse(word):
        raise ValueError(f"{word} is no number of JSON")

    try:
        content = json.loads(_text(path), parse_constant=refuse)
    except ValueError as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path}: {error}", str(path)) from None
    if not isinstance(content, dict) or content.get("etalon") != kind:
        raise ConfigError(f"{path}: etalon: is not {kind}", str(path), 0, "etalon")
    return content


def read_record(folder):
    """A run's record as a dict: all of run.json (docs/files.md), and `poses`, the columns of poses.csv.

    Units stand in the columns' names; linear axes in mm, rotary axes in deg, biases in mm and mrad. Reads
    what was written: etalon.analyse_record() analyses the photographs again. Raises ConfigError.
    """
    folder = path_of(folder, "folder")
    record = _json(folder / "run.json", "run/1")
    record["poses"] = read_table(folder / "poses.csv", text=("split",))
    return record


def read_results(folder):
    """A study's results as a dict: all of study.json, `results` and `summary`, the columns of its tables.

    Errors are estimated minus true, in mm and deg (docs/study.md). Raises ConfigError.
    """
    folder = path_of(folder, "folder")
    study = _json(folder / "study.json", "study-record/1")
    words = ("variant", "detector", "failure", "set", "measure", "unit")
    study["results"] = read_table(folder / "results.csv", text=words)
    if (folder / "summary.csv").exists():
        study["summary"] = read_table(folder / "summary.csv", text=words)
    return study
