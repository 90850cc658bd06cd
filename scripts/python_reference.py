"""Prints the page of `import etalon`: each name's signature as python/etalon/__init__.pyi has it, and
its own docstring. Needs the built module in PYTHONPATH."""

import ast
import inspect
import re
import sys

import etalon


def documentation(thing):
    """What `help()` says below the signature that pybind11 writes first, as a list of lines."""
    lines = inspect.cleandoc(getattr(thing, "__doc__", None) or "").split("\n")
    while lines and ("->" in lines[0] or not lines[0].strip()):
        lines = lines[1:]
    return lines


def signature(node, lines):
    """The lines of a declaration, with the comments that give shapes; a class without its members."""
    last = node.body[0].lineno if isinstance(node, ast.ClassDef) else node.end_lineno
    first = min([node.lineno] + [decorator.lineno for decorator in node.decorator_list])
    text = lines[first - 1:max(first, last - isinstance(node, ast.ClassDef))]
    return inspect.cleandoc("\n".join(text)).replace(": ...", "").removesuffix(":")


def print_members(node, thing, lines):
    told = set()
    members = [member for member in node.body if isinstance(member, ast.FunctionDef)]
    for member in members:
        overloads = [other for other in members if other.name == member.name]
        if member.name in told or (member.name.startswith("_") and member.name != "__init__"):
            continue
        told.add(member.name)
        print(f"\n### {node.name}.{member.name}\n" if member.name != "__init__" else "")
        print("```python\n" + "\n".join(signature(other, lines) for other in overloads) + "\n```\n")
        print("\n".join(documentation(getattr(thing, member.name) if member.name in vars(thing) else None)))


def main(stub):
    lines = open(stub, encoding="utf-8").read().split("\n")
    tree = ast.parse("\n".join(lines))
    introduction = ast.get_docstring(tree).replace("docs/", "")
    print("# Python reference\n\n" + re.sub(r"(\w+\.md)", r"[\1](\1)", introduction))
    for node in tree.body:
        if not isinstance(node, (ast.ClassDef, ast.FunctionDef)) or node.name.startswith("_"):
            continue
        thing = getattr(etalon, node.name)
        print(f"\n## {node.name}\n\n```python\n{signature(node, lines)}\n```\n")
        print("\n".join(documentation(thing)))
        if isinstance(node, ast.ClassDef):
            print_members(node, thing, lines)


main(sys.argv[1])
