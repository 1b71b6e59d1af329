"""Reading a job: safe YAML, overrides from the command line, and one message for every mistake."""

import re
from pathlib import Path

import yaml

from parmps.errors import InputError
from parmps.fields import dotted, show, validated
from parmps.scene import Job

MAX_BYTES = 2**18  # takes PyYAML about a second
MAX_DEPTH = 50
MAX_NODES = 10_000

# Numbers, truth values and null as in the core schema of YAML 1.2. Version 1.1, PyYAML's own, reads 1e-6 as
# text, 060 as 48 and 1:30 as 90.
_CORE_SCHEMA = (
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?",
        list("-+.0123456789"),
    ),
)


class _Loader(yaml.SafeLoader):
    """Plain data only, without repeated keys."""

    yaml_implicit_resolvers = {}


class _Dumper(yaml.SafeDumper):
    """Quotes text that either version of YAML would read as something else."""


def _construct_mapping(loader, node):
    mapping = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise _problem(f"the key {show(key)} must be text", key_node)
        if key in mapping:
            raise _problem(f"the key '{dotted([key])}' is given twice", key_node)
        mapping[key] = loader.construct_object(value_node, deep=True)
    return mapping


def _construct_int(loader, node):
    # text longer than any sensible integer would be refused by int() itself; as a float it fails validation
    return int(node.value) if len(node.value) <= 18 else float(node.value)


def _problem(text, node):
    return yaml.constructor.ConstructorError(None, None, text, node.start_mark)


_Loader.add_constructor("tag:yaml.org,2002:map", _construct_mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _construct_int)
_Loader.add_constructor("tag:yaml.org,2002:float", lambda loader, node: float(node.value))
for _tag, _pattern, _first in _CORE_SCHEMA:
    for _reader in (_Loader, _Dumper):
        _reader.add_implicit_resolver(_tag, re.compile(rf"(?:{_pattern})\Z"), _first)


def read_yaml(text, source):
    """Read YAML text as plain data: mappings, lists, text, numbers, true, false and null.

    Parameters
    ----------
    text : str
    source : str
        What to call the text in messages.

    Returns
    -------
    object

    Raises
    ------
    InputError
        Names the line: a syntax error, a repeated key, a tag, an alias, or text that is too large or nested
        too deep.
    """
    try:
        _check_events(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        problem = error.problem or error.context
        if problem.startswith("but ") and error.context:
            problem = f"{error.context}, {problem}"
        raise InputError("", f"{source}{line}: {problem}") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(
            "", f"{source}, line {line}: the character {error.character:#x} is not allowed"
        ) from None
    except (ValueError, OverflowError):
        # PyYAML lets these through for escapes and version numbers that are out of range
        raise InputError("", f"{source}: an escape or directive has a number out of range") from None


def _check_events(text):
    """Refuse, before anything is built, what could grow without bound or name Python objects."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise _problem("aliases (*name) are not allowed; write the value out", event)
        if getattr(event, "tag", None) is not None:
            raise _problem(f"tags are not allowed: {show(event.tag)}", event)
        if isinstance(event, yaml.NodeEvent):
            nodes += 1
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            raise _problem(f"nested more than {MAX_DEPTH} deep", event)
        if nodes > MAX_NODES:
            raise _problem(f"more than {MAX_NODES} values", event)


def read_text(path):
    """Read a file of bounded size as UTF-8 text.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    str

    Raises
    ------
    InputError
        The file is missing, cannot be read, is larger than 256 KiB or is not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError("", f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError("", f"{show(str(path))}: not a file name") from None
    if len(data) > MAX_BYTES:
        raise InputError("", f"{path}: must be at most {MAX_BYTES // 2**10} KiB")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError("", f"{path}, line {line}: not UTF-8 text") from None


def load_job(path, overrides=()):
    """Read, override and validate a job file.

    Parameters
    ----------
    path : str or Path
        YAML job file; relative paths in it, and in the overrides, are relative to its directory.
    overrides : iterable of str
        ``path.to.key=value`` each, as given to ``--set``; list items as ``motion[0].omega`` or
        ``motion.0.omega``. The value is read as YAML.

    Returns
    -------
    Job

    Raises
    ------
    InputError
        One message that names the first offending key, the value found and what is allowed.
    """
    file = Path(path).absolute()
    return parse_job(read_text(path), overrides, file=file, source=str(path))


def parse_job(text, overrides=(), file=None, source="job"):
    """Validate a job from YAML text, such as :func:`job_text` gives.

    Parameters
    ----------
    text : str
    overrides : iterable of str
        As in :func:`load_job`.
    file : Path, optional
        Absolute path of the job file, whose directory relative paths start from; without, the working
        directory.
    source : str
        What to call the text in messages.

    Returns
    -------
    Job

    Raises
    ------
    InputError
    """
    data = read_yaml(text, source)
    if not isinstance(data, dict):
        found = "nothing" if data is None else show(data)
        raise InputError("", f"{source}: got {found}, must be a mapping of keys such as dimension, tank, fluids")
    for override in overrides:
        apply_override(data, override)
    return validated(Job, data, context={"file": file})


def job_text(job):
    """Write a job as YAML text that :func:`parse_job` turns back into an equal job.

    Parameters
    ----------
    job : Job

    Returns
    -------
    str
    """
    return yaml.dump(job.model_dump(mode="json"), Dumper=_Dumper, sort_keys=False, allow_unicode=True)


_PATH = re.compile(r"[A-Za-z_]+(?:\.[0-9A-Za-z_]+|\[[0-9]+\])*")
# Keys whose value may be text that stands for a mapping with this one key.
_SHORT_FORMS = {"scheme": "preset", "initial": "kind"}


def apply_override(data, override):
    """Set one value in the plain data of a job.

    Parameters
    ----------
    data : dict
        Changed in place. Sections on the way that are absent are made; list items must exist.
    override : str
        ``path.to.key=value``.

    Raises
    ------
    InputError
        The path cannot be followed, or the value is not YAML.
    """
    path_text, equals, value_text = override.partition("=")
    steps = _parse_path(path_text.strip())
    if not equals or not steps:
        raise InputError(
            "", f"--set {show(override)}: must be path.to.key=value, such as motion[0].omega=3.5"
        )
    value = read_yaml(value_text, f"--set {path_text}")
    place = data
    for number, step in enumerate(steps[:-1]):
        place = _descend(place, steps[:number], step)
        if isinstance(place, str) and number == 0 and step in _SHORT_FORMS:
            place = data[step] = {_SHORT_FORMS[step]: place}
    _check_step(place, steps[:-1], steps[-1])
    place[steps[-1]] = value


def _parse_path(text):
    """Split ``motion[0].omega`` or ``motion.0.omega`` into keys and indices; empty when it is no path."""
    if len(text) > 200 or not _PATH.fullmatch(text):
        return []
    return [int(step) if step.isdigit() else step for step in re.findall(r"[0-9A-Za-z_]+", text)]


def _descend(place, path, step):
    """Follow one step of an override, making the section when it is absent."""
    _check_step(place, path, step)
    if isinstance(place, dict):
        if place.get(step) is None:
            place[step] = {}
        return place[step]
    return place[step]


def _check_step(place, path, step):
    """Refuse a step that does not fit the place: an index into a mapping, a key into a list or a value."""
    key = dotted(path)
    if isinstance(place, list):
        if not isinstance(step, int):
            raise InputError(dotted([*path, step]), f"{key} is a list; give an index, such as {key}[0]")
        if step >= len(place):
            raise InputError(dotted([*path, step]), f"no such entry; {key} has {len(place)}")
    elif not isinstance(place, dict):
        raise InputError(dotted([*path, step]), f"{key} is {show(place)}, which has no keys")
    elif isinstance(step, int):
        raise InputError(dotted([*path, step]), f"no such entry; {key or 'the job'} is not a list")
