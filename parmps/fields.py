"""Building blocks of the validated models: strict number types, and one readable message per mistake.

Every key of a job file is a field of a :class:`Section`. The field carries its meaning, unit, default and
bounds, so that validation, error messages, the schema table and the JSON Schema have a single source.
"""

import difflib
import re
from types import NoneType
from typing import Annotated, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from parmps.errors import InputError

_EXPONENT_WITHOUT_POINT = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+")


def _exponent_text_to_float(value):
    """Turn ``"1e-6"`` into a number: YAML 1.1 readers hand it over as text."""
    if isinstance(value, str) and _EXPONENT_WITHOUT_POINT.fullmatch(value):
        return float(value)
    return value


Number = Annotated[float, Field(strict=True, allow_inf_nan=False), BeforeValidator(_exponent_text_to_float)]
Length = Annotated[Number, Field(gt=0, le=1e4)]
Coordinate = Annotated[Number, Field(ge=-1e4, le=1e4)]
Point = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3)]

PATTERNS = {
    "name": (
        r"^\w[\w .+-]{0,63}$",
        "must be 1 to 64 letters, digits, spaces or _ . + -, beginning with a letter or digit",
    ),
    "path": (r"^[^\x00-\x1f\x7f]+$", "must be a file path without control characters"),
    "option": (r"^--?[^\s\x00-\x1f][^\x00-\x1f]*$", "must be one option, such as --time=02:00:00"),
    "command": (r"^[^\x00-\x1f'\"\\]+$", "must be words without quotes, such as srun --mpi=pmix"),
}
"""Patterns of texts, and how a message says them."""

Name = Annotated[str, Field(pattern=PATTERNS["name"][0])]
FilePath = Annotated[str, Field(min_length=1, max_length=4096, pattern=PATTERNS["path"][0])]
Option = Annotated[str, Field(max_length=200, pattern=PATTERNS["option"][0])]
Command = Annotated[str, Field(max_length=500, pattern=PATTERNS["command"][0])]

TAG_MARK = "@"


class Section(BaseModel):
    """A mapping of the job file: immutable, and with no keys but those declared."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)

    @model_validator(mode="before")
    @classmethod
    def _empty_is_absent(cls, data):
        """Take a key without a value, such as ``motion:`` with nothing below it, as one that is not there."""
        if not isinstance(data, dict):
            return data
        optional = {
            name
            for name, field in cls.model_fields.items()
            if not field.is_required() and NoneType not in get_args(field.annotation)
        }
        return {name: value for name, value in data.items() if value is not None or name not in optional}


def setting(description, unit="", default=..., **bounds):
    """Declare one key of the job file.

    Parameters
    ----------
    description : str
        What the key means, for the schema table.
    unit : str
        SI unit; empty for text, counts and ratios.
    default : object
        Value used when the key is absent; left out for a required key.
    **bounds
        ``gt``, ``ge``, ``lt``, ``le``, ``min_length``, ``max_length`` as in :func:`pydantic.Field`.

    Returns
    -------
    pydantic.fields.FieldInfo
    """
    return Field(default=default, description=description, json_schema_extra={"unit": unit}, **bounds)


def unit_of(field):
    """Return the unit of a field declared by :func:`setting`, as text."""
    return (field.json_schema_extra or {}).get("unit", "")


def models_in(annotation):
    """All :class:`Section` classes that occur in a type annotation, in order of appearance."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def nearest(name, options):
    """Suggest the option that looks most like a mistyped name.

    Returns
    -------
    str
        ``"; did you mean 'tank'?"``, or the list of options when none is similar.
    """
    close = difflib.get_close_matches(str(name)[:64], options, n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else f"; allowed are {', '.join(options)}"


def show(value, limit=60):
    """Write a value into a message: on one line, cut off when it is long."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def dotted(path):
    """Write a path of keys and list indices as ``motion[0].centre[1]``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            shown = part if part.isprintable() and len(part) <= 64 else show(part)
            text += f".{shown}" if text else shown
    return text


def input_error(error, model, prefix=()):
    """Turn pydantic's report into one message about the first mistake.

    An unknown key goes before all else: it usually is a typing error that also makes a key missing.

    Parameters
    ----------
    error : pydantic.ValidationError
    model : type
        The :class:`Section` that was validated.
    prefix : tuple
        Path of that section in the job file.

    Returns
    -------
    InputError
    """
    reports = error.errors(include_url=False)
    first = next((report for report in reports if report["type"] == "extra_forbidden"), reports[0])
    path, owner, field = _locate(first["loc"], model)
    key = dotted((*prefix, *path))
    kind, value = first["type"], first["input"]
    if kind == "extra_forbidden":
        return InputError(key, f"unknown key{nearest(path[-1], list(owner.model_fields))}")
    if kind == "missing":
        return InputError(key, f"missing; {field.description}{_in_unit(field)}")
    if kind == "kind":
        members = models_in(field.annotation)
        return _kind_error(key, value, [name for member in members for name in member.kinds()])
    return InputError(key, f"got {show(value)}, {_rule(kind, first)}{_in_unit(field)}")


def _locate(location, model):
    """Follow an error's location through the models.

    Returns
    -------
    path : list
        The location without the marks of union members.
    owner : type
        The section that holds the last key.
    field : FieldInfo or None
        The field of the last key, or of the list that holds the last index.
    """
    path, owner, section, field = [], model, model, None
    candidates = []
    for part in location:
        member = next((each for each in candidates if part == TAG_MARK + each.__name__), None)
        if member:
            section, candidates = member, []
            continue
        path.append(part)
        if isinstance(part, int):
            continue
        owner = section
        field = owner.model_fields.get(part)
        candidates = models_in(field.annotation) if field else []
        section = candidates[0] if candidates else owner
    return path, owner, field


def _in_unit(field):
    unit = unit_of(field) if field else ""
    return f" ({unit})" if unit else ""


def _kind_error(key, value, allowed):
    if not isinstance(value, dict):
        return InputError(key, f"got {show(value)}, must be a mapping with a kind: {', '.join(allowed)}")
    key = f"{key}.kind" if key else "kind"
    if "kind" not in value:
        return InputError(key, f"missing; must be one of {', '.join(allowed)}")
    hint = nearest(value["kind"], allowed)
    return InputError(
        key,
        f"got {show(value['kind'])}, must be one of {', '.join(allowed)}"
        + (hint if "did you mean" in hint else ""),
    )


_RULES = {
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "string_unicode": "must be valid Unicode text",
    "string_too_long": "must have at most {max_length} characters",
    "string_too_short": "must not be empty",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "literal_error": "must be {expected}",
    "model_type": "must be a mapping of keys",
    "dict_type": "must be a mapping of keys",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
}


def _rule(kind, report):
    """State what is allowed where a value was refused."""
    if kind == "string_pattern_mismatch":
        return dict(PATTERNS.values())[report["ctx"]["pattern"]]
    if kind in _RULES:
        return _RULES[kind].format(**report.get("ctx", {}))
    return report["msg"]


def validated(model, value, prefix=(), context=None):
    """Validate a value against a section.

    Parameters
    ----------
    model : type
        The :class:`Section` to build.
    value : object
        Plain data as read from a file.
    prefix : tuple
        Path of the section in the job file, for messages.
    context : dict, optional
        Passed to the validators.

    Returns
    -------
    Section

    Raises
    ------
    InputError
        Names the first offending key, the value found and what is allowed.
    """
    try:
        return model.model_validate(value, context=context)
    except ValidationError as error:
        raise input_error(error, model, prefix) from None
