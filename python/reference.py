"""Writes docs/reference/python.md from the built module and its stubs: `python reference.py > ../docs/reference/python.md`.

Signatures with their types are those of `_erfgs.pyi` and of the package's own sources, texts those of the module's docstrings.
"""

import ast
import inspect
import pathlib
import textwrap

import erfgs

PACKAGE = pathlib.Path(__file__).parent / "package/erfgs"
HEAD = """# Python

Every call of the module `erfgs`. [The guide](../guide/python.md) shows how they go together. This page is generated from the module
(`python/reference.py`), and a test compares it.

Every time is in microseconds: those of a recording begin with it and are the same for all of its streams. Arrays are NumPy's. Files that
are refused raise `erfgs.Error` with what to do about it.
"""
ORDER = ["open", "Recording", "Stream", "Frame", "Slice", "SliceDataset", "Clock", "ClockPart", "Rig", "Camera", "Dataset"]
ORDER += ["DatasetCamera", "FrameTime", "Scene", "Rendering", "Gaussians", "train", "Training", "Trained", "simulate", "Simulator", "FrameIterator", "SliceIterator", "EVENT_DTYPE", "Error", "DamageWarning"]


def text(docs):
    """Paragraphs of a docstring, wrapped; code stays."""
    parts = inspect.cleandoc(docs or "").split("\n\n")
    return "\n\n".join(part if part.startswith("    ") else textwrap.fill(part, 140, break_long_words=False) for part in parts if part)


def short(annotation):
    said = ast.unparse(annotation)
    for long, plain in [("Union[str, os.PathLike[str]]", "str | PathLike"), ("NDArray[np.", "NDArray["), ("'", '"')]:
        said = said.replace(long, plain)
    return said


def signature(function, bound):
    """A call as one writes it."""
    arguments = function.args
    plain = [*arguments.posonlyargs, *arguments.args][1 if bound else 0 :]
    defaults = [None] * (len(plain) - len(arguments.defaults)) + list(arguments.defaults)
    said = [argument(name, default) for name, default in zip(plain, defaults)]
    if arguments.kwonlyargs:
        said += ["*", *(argument(name, default) for name, default in zip(arguments.kwonlyargs, arguments.kw_defaults))]
    if arguments.kwarg:
        said.append(f"**{argument(arguments.kwarg, None)}")
    back = f" -> {short(function.returns)}" if function.returns and ast.unparse(function.returns) != "None" else ""
    return f"({', '.join(said)}){back}"


def argument(name, default):
    typed = f"{name.arg}: {short(name.annotation)}" if name.annotation else name.arg
    return typed if default is None else f"{typed} = {ast.unparse(default)}"


def trees():
    for file in ["_erfgs.pyi", "_types.py", "data.py", "training.py", "video.py"]:
        for node in ast.parse((PACKAGE / file).read_text()).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
                yield node.name, node


def is_a(node, kind):
    return any(ast.unparse(decorator) == kind for decorator in node.decorator_list)


def members(name, tree):
    fields = iter([*tree.body[1:], None])
    for node, after in zip(tree.body, fields):
        if isinstance(node, ast.AnnAssign):
            yield f"`{node.target.id}: {short(node.annotation)}`", ast.literal_eval(after.value)
        if not isinstance(node, ast.FunctionDef) or is_a(node, "overload"):
            continue
        docs = getattr(getattr(erfgs, name), node.name).__doc__
        if is_a(node, "property"):
            yield f"`{node.name}: {short(node.returns)}`", docs
        elif node.name in ("__init__", "__new__"):
            yield f"`{name}{signature(node, True)}`".replace(f" -> {name}`", "`"), ""
        elif node.name == "__getitem__":
            yield f"`[{node.args.args[-1].arg if node.args.args[1:] else 'name'}] -> {short(node.returns)}`", ""
        elif not node.name.startswith("_"):
            static = is_a(node, "staticmethod")
            yield f"`{name + '.' if static else ''}{node.name}{signature(node, not static)}`", docs


def page():
    found = dict(trees())
    assert sorted([*ORDER, "__version__"]) == sorted(erfgs.__all__), "a name that is exported and has no place on the page"
    yield HEAD
    for name in ORDER:
        yield f"## {name}\n"
        if name == "EVENT_DTYPE":
            yield "The type of an event, as Metavision lays it out in 16 bytes: `x` and `y` (uint16, pixels), `p` (int16; 1 for a rise, 0 for a"
            yield "fall), `t` (int64, microseconds).\n"
            continue
        if isinstance(found[name], ast.FunctionDef):
            yield f"`erfgs.{name}{signature(found[name], False)}`\n"
        yield text(getattr(erfgs, name).__doc__) + "\n"
        listed = [(head, " ".join(text(docs).split("\n"))) for head, docs in members(name, found[name])] if isinstance(found[name], ast.ClassDef) else []
        for head, docs in listed:
            said = textwrap.fill(f"- {head}" + (f": {docs}" if docs else ""), 140, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
            yield said
        if listed:
            yield ""


def whole():
    return "\n".join(page()).rstrip() + "\n"


if __name__ == "__main__":
    print(whole(), end="")
