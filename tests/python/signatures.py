"""Every function of the interface with its arguments, from the .pyi file, and what none of them can be."""

import ast
from pathlib import Path

import numpy
import pytest
from conftest import pose

import etalon

STUB = ast.parse(Path(etalon.__file__).with_suffix(".pyi").read_text())
PHOTO = numpy.zeros((384, 512), numpy.uint8)
RADIANCE = numpy.zeros((384, 512), numpy.float32)
CORNERS = numpy.array([[0, 0], [9, 0], [9, 7], [0, 8]], float)


def functions():
    """{("Camera", "project"): {"points_camera": "ArrayLike", ...}}; of a function alone the class is ""."""
    found = {}

    def add(owner, body):
        for node in body:
            if isinstance(node, ast.FunctionDef) and node.name != "__exit__":
                every = node.args.args + node.args.kwonlyargs
                named = {one.arg: ast.unparse(one.annotation) for one in every if one.annotation}
                if named:
                    found[owner, node.name] = named

    add("", STUB.body)
    for node in STUB.body:
        if isinstance(node, ast.ClassDef) and not issubclass(getattr(etalon, node.name), Exception):
            add(node.name, node.body)
    return found


def unaligned(array):
    """The same numbers at an address that is no multiple of their size."""
    raw = numpy.zeros(array.nbytes + 1, numpy.uint8)
    raw[1:] = numpy.frombuffer(array.tobytes(), numpy.uint8)
    return raw[1:].view(array.dtype).reshape(array.shape)


def wrong_images(right):
    other = numpy.float32 if right.dtype == numpy.uint8 else numpy.uint8
    types = [other, numpy.float64, numpy.longdouble, numpy.int32, bool, complex, object, ">u2", ">f4", "M8[s]", "S3"]
    yield from (right.astype(one) for one in types if numpy.dtype(one).kind not in "MS")
    yield from (numpy.zeros(right.shape, one) for one in ("M8[s]", "S3", [("a", "u1")]))
    yield from (right.tolist(), right[None], right[0], right[:0], right[:, :0], numpy.array(right[0, 0]), 7)
    yield from (right[:, ::-1], right[::-1], right[:, ::2], numpy.asfortranarray(right))
    yield numpy.broadcast_to(right[:1], right.shape)  # rows of one memory
    wide = numpy.uint16 if right.dtype == numpy.uint8 else right.dtype
    yield unaligned(right.astype(wide))


def wrong_values(annotation, camera, tag):
    """What an argument of such an annotation must refuse."""
    values = {
        "ArrayLike": [
            *(numpy.ones((2, 3), one) for one in (numpy.longdouble, complex, bool, object, "M8[s]", "S3")),
            numpy.zeros((2, 3), [("x", "f8")]), numpy.zeros((2, 2, 2, 7)), numpy.float64(5), 5, "abc", [[1, 2], [3]],
            camera, {"x": 1},
        ],
        "_Image": wrong_images(PHOTO),
        "_Radiance": wrong_images(RADIANCE),
        "_Path": [5, 2.5, numpy.zeros(3), ["a"], camera],
        "str": [5, numpy.zeros(3), ["a"], camera],
        "int": ["1", 2.5, 2**70, -(2**70), 10**5000, numpy.zeros(3), [1]],
        "float": ["1", 1j, numpy.zeros(3), [1.0], camera],
        "bool": ["yes", numpy.zeros(3), camera],
        "Marker": ["tag", 5, camera],
        "Camera": ["camera", 5, tag],
        "tuple[int, int]": [5, (1,), (1, 2, 3), ("a", "b"), (1.5, 2), (2**70, 1)],
        "Iterable[tuple[Marker, ArrayLike]]": [5, "ab", [tag], [(pose(0, 0, 0, 0, 0, 300), tag)], [(tag,)], [None]],
        "Sequence[_Image]": [5, "ab", [None], [PHOTO.tolist()], [PHOTO.astype(float)], [PHOTO[None]]],
        "Sequence[CalibrationView]": [5, "ab", [None], ["a"], [PHOTO]],
        "Sequence[str]": [5, "ab", [None], [5]],
        "Mapping[str, float]": [5, ["a"], {"a": "b"}, {5: 1.0}],
    }
    plain = annotation.removesuffix(" | None")
    if plain.startswith("Literal"):
        plain = "str" if "'" in plain else "bool"
    return [*values[plain], *([] if annotation.endswith("| None") else [None])]


def check(function, right, annotations, camera, tag):
    """Each argument in turn is refused by its name; the others are right."""
    for name, annotation in annotations.items():
        for wrong in wrong_values(annotation, camera, tag):
            with pytest.raises((TypeError, ValueError)) as caught:
                function(**{**right, name: wrong})
            assert str(caught.value).startswith(f"{name}: "), (name, type(wrong), str(caught.value))
            assert isinstance(caught.value, (TypeError, etalon.ConfigError))
