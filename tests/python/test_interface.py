"""The .pyi file says what there is: no more and no less, each with a text that help() shows."""

import ast
import inspect
import pickle
import re
import subprocess
import sys
from pathlib import Path

import etalon

STUB = ast.parse(Path(etalon.__file__).with_suffix(".pyi").read_text())


def members(body):
    functions = (ast.FunctionDef, ast.ClassDef)
    return {node.name for node in body if isinstance(node, functions) and not node.name.startswith("_")}


def public(thing):
    return {name for name in vars(thing) if not name.startswith("_")}


def test_the_interface_is_what_is_there():
    modules = {"copies", "errors", "records", "testing"}  # where the parts in Python live
    assert members(STUB.body) == public(etalon) - modules
    for node in STUB.body:
        if isinstance(node, ast.ClassDef) and not issubclass(getattr(etalon, node.name), Exception):
            assert members(node.body) == public(getattr(etalon, node.name)), node.name


def test_everything_has_a_text():
    for name in members(STUB.body):
        thing = getattr(etalon, name)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member in public(thing):
                assert inspect.getdoc(getattr(thing, member)), f"{name}.{member}"


def arguments(function):
    """Names of a function's arguments; of a compiled one as the first line of its text has them."""
    if inspect.isfunction(function):
        return list(inspect.signature(function).parameters)
    return re.findall(r"[(,] ?(\w+)(?=:)", function.__doc__.splitlines()[0])


def test_arguments_have_the_names_of_the_interface():
    checked = 0
    for node in ast.walk(STUB):
        scope = getattr(etalon, node.name, None) if isinstance(node, ast.ClassDef) else etalon
        if not isinstance(node, (ast.ClassDef, ast.Module)) or (
            inspect.isclass(scope) and issubclass(scope, Exception)
        ):
            continue
        for function in node.body:
            properties = not isinstance(function, ast.FunctionDef) or "property" in ast.dump(function)
            if properties or function.name == "__exit__":
                continue
            named = [one.arg for one in function.args.args + function.args.kwonlyargs]
            found = arguments(getattr(scope, function.name))
            assert [name for name in found if name != "self"] == [n for n in named if n != "self"], function.name
            checked += 1
    assert checked > 50


def test_errors_go_from_process_to_process():
    error = pickle.loads(pickle.dumps(etalon.ConfigError("a:3: b: wrong", "a", 3, "b")))
    assert (str(error), error.file, error.line, error.key) == ("a:3: b: wrong", "a", 3, "b")
    assert issubclass(etalon.DeviceError, etalon.Error) and issubclass(etalon.Error, RuntimeError)


def test_no_file_takes_the_number_of_a_closed_standard_descriptor():
    script = "import etalon, os; print(os.open(os.devnull, os.O_RDONLY))"
    shell = f'exec "{sys.executable}" -c "{script}" <&- 2>&-'
    opened = subprocess.run(["sh", "-c", shell], stdout=subprocess.PIPE, check=True, text=True)
    assert int(opened.stdout) > 2
