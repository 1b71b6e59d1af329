"""Every key of a job file, generated from the models: as text for people, as JSON Schema for editors."""

import json
import re
import textwrap
import types
from typing import Annotated, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined

from parmps.fields import models_in, unit_of
from parmps.scene import Job

_COMPARISONS = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))


def schema_rows(model=Job):
    """List every key of a job file.

    Parameters
    ----------
    model : type
        The `Section` of another file, such as a sweep.

    Returns
    -------
    list of tuple
        ``(key, type, unit, default, meaning)``, all text. Entries of lists are written ``fluids[].name``;
        where sections of several kinds can stand, as ``motion[](surge, sway, heave).omega``.
    """
    return list(_rows(model, ""))


def unit_of_key(key):
    """Return the unit of a key of a job.

    Parameters
    ----------
    key : str
        As ``--set`` takes it, such as ``motion[0].omega``.

    Returns
    -------
    str
        Empty where it has none, or is no key of a single value.
    """
    general = re.sub(r"\[\d+\]|\.\d+(?=\.|$)", "[]", key).removesuffix("[]")
    rows = ((re.sub(r"\(.*?\)", "", row), unit) for row, _, unit, *_ in schema_rows())
    return next((unit for row, unit in rows if row == general), "")


def schema_table(model=Job, width=120):
    """Format the list of keys for reading.

    Parameters
    ----------
    model : type
        As in `schema_rows`.
    width : int
        Columns of the terminal.

    Returns
    -------
    str
        One paragraph a key: key, type, unit and default on the first line, the meaning below.
    """
    lines = []
    for key, kind, unit, default, meaning in schema_rows(model):
        lines.append(f"{key}: {kind}{f' ({unit})' if unit else ''}, {default}")
        lines += textwrap.wrap(meaning, width, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines) + "\n"


def schema_markdown(model=Job):
    """Format the list of keys as a table of Markdown, as in the README.

    Parameters
    ----------
    model : type
        As in `schema_rows`.

    Returns
    -------
    str
    """
    lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, *cells in schema_rows(model):
        texts = [cell.replace("|", "\\|").replace("<", "&lt;") for cell in cells]
        texts[2] = texts[2].removeprefix("default ")
        lines.append(" | ".join([f"| `{key}`", *texts]) + " |")
    return "\n".join(lines) + "\n"


def json_schema(model=Job):
    """JSON Schema of a job file, for completion and checks in editors.

    Parameters
    ----------
    model : type
        As in `schema_rows`.

    Returns
    -------
    dict
    """
    schema = model.model_json_schema(mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _rows(model, prefix):
    for name, field in model.model_fields.items():
        key = f"{prefix}{name}"
        sections = models_in(field.annotation)
        listed = "[]" if get_origin(_core(field.annotation)) is tuple else ""
        kind = _describe(field.annotation, _bounds(field.metadata))
        yield key, kind, unit_of(field), _default(field), field.description
        for section in sections:
            kinds = f"({', '.join(section.kinds())})" if hasattr(section, "kinds") else ""
            yield from _rows(section, f"{key}{listed}{kinds}.")


def _core(annotation):
    """Strip Annotated and an optional None from a type."""
    if get_origin(annotation) is Annotated:
        return _core(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        members = [part for part in get_args(annotation) if part is not type(None)]
        return _core(members[0])
    return annotation


def _bounds(metadata):
    """Write the bounds that a type's metadata holds."""
    parts = []
    for item in metadata:
        for constraint in getattr(item, "metadata", [item]):
            parts += [
                f"{sign} {getattr(constraint, name):g}"
                for name, sign in _COMPARISONS
                if hasattr(constraint, name)
            ]
    return " and ".join(parts)


def _describe(annotation, bounds=""):
    """Name a type and its bounds in words."""
    if get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        return _describe(inner, bounds or _bounds(metadata))
    if get_origin(annotation) in (Union, types.UnionType):
        members = get_args(annotation)
        if models_in(annotation):
            return "mapping" + (" or null" if type(None) in members else "")
        words = [_describe(part, bounds) for part in members if part is not type(None)]
        return " or ".join(words) + (" or null" if type(None) in members else "")
    if get_origin(annotation) is Literal:
        return " | ".join(str(value) for value in get_args(annotation))
    if get_origin(annotation) is tuple:
        return f"list of {_plural(_describe(get_args(annotation)[0]))}"
    names = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    return (names.get(annotation, "mapping") + (f" {bounds}" if bounds else "")).strip()


def _plural(words):
    first, _, rest = words.partition(" ")
    plural = {"number": "numbers", "text": "texts", "mapping": "mappings", "list": "lists"}.get(first, first)
    return f"{plural} {rest}".strip()


def _default(field):
    if field.is_required():
        return "required"
    if models_in(field.annotation) and field.default is not None and field.default != ():
        return "optional"
    if field.default is PydanticUndefined:
        return "optional"
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return f"default {json.dumps(default)}"
