"""The schemas that `etalon schema` makes agree with the reader that they are made of.

Every example is accepted by both. Damaged ones (an unknown key, a key that is gone, a wrong type, a
number or word out of range) are refused by both; what only the reader refuses, because one key needs
another, is counted, and is never anything but a key that is gone or two that exclude each other. What
the schema refuses the reader refuses, always. Exit 77 (skipped) without python3-jsonschema.
    tests/schemas.py BUILD_FOLDER [DAMAGED]
"""
import copy
import json
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile

try:
    import jsonschema
    import yaml
except ImportError as missing:
    print(missing)
    sys.exit(77)

build, damaged = pathlib.Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 200
source = pathlib.Path(__file__).resolve().parent.parent
every = source / "examples/every-key"
examples = sorted([*every.glob("camera*.yml"), *every.glob("station*.yaml"), every / "limits.yaml",
                   every / "stage-profile.yaml", *(source / "stage/profiles").glob("*.yaml"),
                   *every.glob("twin*.yaml"), *(source / "examples").glob("[dc]*/[!.]*.y*ml"),
                   *(source / "examples/study").glob("*.yaml")])
random.seed(1)


class Loader(yaml.SafeLoader):
    """As editors read YAML 1.2: 1e-5 is a number."""


Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9.]+[eE][-+]?[0-9]+$"),
                             list("-+.0123456789"))
Loader.add_constructor("tag:yaml.org,2002:map", lambda loader, node: {
    str(key): value for key, value in loader.construct_mapping(node, deep=True).items()})


def is_twin(path):
    return path.name.startswith("twin")


def refusal(path, out):
    """What the reader says against the file; empty if it reads it."""
    command = ["etalon-twin", "--schema", out, path] if is_twin(path) else ["etalon", "schema", "--out", out, path]
    done = subprocess.run([build / command[0], *command[1:]], capture_output=True, text=True)
    assert done.returncode in (0, 3), done.stderr
    return done.stderr


def places(value, path=()):
    """Every mapping key, as the path to it."""
    if isinstance(value, dict):
        for key, below in value.items():
            yield path + (key,)
            yield from places(below, path + (key,))
    if isinstance(value, list):
        for index, below in enumerate(value):
            yield from places(below, path + (index,))


def damage(document):
    """A copy with one fault, and which."""
    document = copy.deepcopy(document)
    path = random.choice([path for path in places(document) if path != ("etalon",)])
    holder = document
    for step in path[:-1]:
        holder = holder[step]
    key, value = path[-1], holder[path[-1]]
    kind = random.choice(["gone", "unknown", "type", "range"])
    if kind == "gone":
        del holder[key]
    elif kind == "unknown":
        holder["no_such_key"] = 1
    elif kind == "type":
        holder[key] = {"no_such_key": 1} if not isinstance(value, dict) else [[]]
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        holder[key] = 1e300
    else:
        return damage(document)
    return document, kind, ".".join(map(str, path))


with tempfile.TemporaryDirectory() as scratch:
    scratch = pathlib.Path(scratch)
    twins = [path for path in every.glob("twin*.yaml")]
    others = [path for path in examples if not is_twin(path)]
    subprocess.run([build / "etalon", "schema", "--out", scratch / "schema", *others], check=True)
    subprocess.run([build / "etalon-twin", "--schema", scratch / "schema", *twins], check=True)
    schemas = {path.stem: jsonschema.Draft202012Validator(json.loads(path.read_text()))
               for path in (scratch / "schema").glob("*.json")}
    documents = {path: yaml.load(path.read_text(), Loader) for path in examples}
    of = lambda document: schemas[document["etalon"].split("/")[0]]
    for path, document in documents.items():
        for error in of(document).iter_errors(document):
            sys.exit(f"{path}: the schema refuses an example: {error.message[:200]}")

    shutil.copytree(source / "examples", scratch / "damaged/examples")
    shutil.copytree(source / "stage/profiles", scratch / "damaged/stage/profiles")
    only_reader, both = [], 0
    for _ in range(damaged):
        path = random.choice(examples)
        broken, kind, place = damage(documents[path])
        file = scratch / "damaged" / path.relative_to(source)
        file.write_text(yaml.safe_dump(broken, sort_keys=False, width=1000))
        refused = refusal(file, scratch / "unused")
        file.write_text(path.read_text())
        errors = list(of(documents[path]).iter_errors(broken))
        what = f"{path.name}: {kind} {place}"
        if errors and not refused:
            sys.exit(f"{what}: only the schema refuses it: {errors[0].message[:200]}")
        both += bool(errors and refused)
        if refused and not errors:
            only_reader.append(f"{what}: {refused.strip()[-120:]}")
    print(f"{both} damaged files are refused by both, {len(only_reader)} by the reader alone:")
    print("\n".join("  " + line for line in only_reader))
    # Which axes there are only the reader knows, where a file's keys are their names.
    unexplained = [line for line in only_reader
                   if ": gone " not in line and ": range " not in line and ".margin." not in line]
    sys.exit(f"more than keys that need each other: {unexplained}" if unexplained else 0)
