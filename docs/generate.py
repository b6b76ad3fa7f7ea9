"""Pages of the site that are made from the code while it is built: keys, commands, families, the notebook."""

import base64
import html
import json
import textwrap
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import click
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from calib import plugins
from calib.cli import main
from calib.cli.catalogue import effect_groups, facts, parameters
from calib.digitise.spec import AxisTable, CurveTable, FigureToml, PanelTable, PointTable, PrintedExcitation
from calib.study_file import schema

NOTEBOOK = Path(__file__).parent / "tutorials" / "notebook.ipynb"
NOTEBOOK_PAGE = "tutorials/notebook.md"
STUDY_TABLES = (
    schema.StudyTable, schema.RecordTable, schema.TableTable, schema.ClockTable, schema.FrequencyTable,
    schema.TrackingTable, schema.ChannelTable, schema.ExcitationTable, schema.ModelTable, schema.EffectTable,
    schema.WindowTable, schema.TermTable, schema.OptimiserTable, schema.PoolTable, schema.StoreTable,
    schema.DiagnosisTable, schema.BenchTable, schema.ConfidenceTable, schema.PriorTable,
)  # fmt: skip
FIGURE_TABLES = (FigureToml, PrintedExcitation, PanelTable, AxisTable, PointTable, CurveTable)
SHOWN = {"float | str": "quantity", "int | str": "column", "float": "number", "int": "integer", "str": "text",
         "bool": "true or false", "dict[str, Any]": "table"}  # fmt: skip

METAVARS = {"INTEGER": "N", "INTEGER RANGE": "N", "FLOAT RANGE": "X", "TEXT": "TEXT"}


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Put what is generated in the place of its marker; links to the notebook lead to its page."""
    if page.file.src_uri != NOTEBOOK_PAGE:
        markdown = markdown.replace(f"{NOTEBOOK.name})", f"{NOTEBOOK.stem}.md)")
    for name, make in GENERATED.items():
        marker = f"<!-- generated: {name} -->"
        if marker in markdown:
            markdown = markdown.replace(marker, make())
    return markdown


def on_files(files: Files, config: Any) -> Files:
    """Add the notebook as a page."""
    files.append(File.generated(config, NOTEBOOK_PAGE, content=notebook_page(NOTEBOOK)))
    return files


# --- keys of TOML files


def keys(tables: tuple[type[BaseModel], ...]) -> str:
    """Return a section for each table: a row for each key."""
    return "\n\n".join(map(_table_of_keys, tables))


def _table_of_keys(table: type[BaseModel]) -> str:
    title, _, rest = (table.__doc__ or table.__name__).strip().partition(": ")
    lead = f"{rest[:1].upper()}{rest[1:]}\n\n" if rest else ""
    required_first = sorted(table.model_fields.items(), key=lambda one: not one[1].is_required())
    rows = [
        f"| `{name}`<br><small>{_kind(field)}{_default(field)}</small> | {field.description or ''} |"
        for name, field in required_first
    ]
    return f"## {title.rstrip('.')}\n\n{lead}| key | meaning |\n|---|---|\n" + "\n".join(rows)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ", required"
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined or isinstance(value, BaseModel) or value in ([], {}, ""):
        return ""
    return f", default `{json.dumps(value)}`"


def _kind(field: FieldInfo) -> str:
    return SHOWN.get(_written(field.annotation), _written(field.annotation)).replace("|", r"\|")


def _written(annotation: Any) -> str:
    """Write a type for a reader of TOML."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        return _written(inner[0])
    if origin is Literal:
        return " or ".join(f"`{json.dumps(value)}`" for value in inner)
    if origin in (typing.Union, types.UnionType):
        written = [_written(part) for part in inner if part is not type(None)]
        return SHOWN.get(" | ".join(_plain(part) for part in inner if part is not type(None)), " or ".join(written))
    if origin is list:
        return f"list of {_written(inner[0])}"
    if origin is dict:
        return f"table, {_written(inner[0])} = {_written(inner[1])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    return SHOWN.get(_plain(annotation), _plain(annotation))


def _plain(annotation: Any) -> str:
    return getattr(annotation, "__name__", str(annotation).removeprefix("typing."))


# --- commands


def commands() -> str:
    """Return a section for each command."""
    return "\n\n".join(_commands(main, "calib"))


def _commands(group: click.Group, path: str) -> Iterator[str]:
    for name, command in group.commands.items():
        here = f"{path} {name}"
        if isinstance(command, click.Group):
            yield from _commands(command, here)
        else:
            yield _command(command, here)


def _command(command: click.Command, path: str) -> str:
    context = click.Context(command, info_name=path)
    usage = " ".join([path, *command.collect_usage_pieces(context)])
    options = [p for p in command.params if isinstance(p, click.Option)]
    rows = "\n".join(_option(option, context) for option in options)
    table = f"\n\n| option | meaning |\n|---|---|\n{rows}" if rows else ""
    return f"## {path}\n\n```text\n{usage}\n```\n\n{_help(command.help or '')}{table}"


def _help(text: str) -> str:
    """Paragraphs; those after a backspace are kept as they are set."""
    parts = []
    for paragraph in text.split("\n\n"):
        lines = paragraph.strip("\n").splitlines()
        if lines and lines[0].strip() == "\b":
            parts.append("```text\n" + "\n".join(lines[1:]) + "\n```")
        else:
            parts.append(" ".join(line.strip() for line in lines))
    return "\n\n".join(parts)


def _option(option: click.Option, context: click.Context) -> str:
    value = "" if option.is_flag else f" {METAVARS.get(option.make_metavar(context), option.make_metavar(context))}"
    default = f" Default: `{option.default}`." if option.show_default else ""
    names = ", ".join(f"`{name}{value}`" for name in option.opts)
    meaning = (option.help or "").replace("[default: ", "Default: ").rstrip("]")
    return f"| {names} | {meaning}{'' if meaning.endswith('.') else '.'}{default} |".replace("|`", "`")


# --- families


def family(group: str) -> str:
    """Return a section for each member of a family."""
    members = plugins.load_all(f"calib.{group}")
    return "\n\n".join(_member(name, item) for name, item in sorted(members.items()))


def effects() -> str:
    """Return a section for each group of effects, with one for each effect in it."""
    members = plugins.load_all("calib.effects")
    parts = []
    for group, names in effect_groups(members).items():
        parts += [f"### Effects: {group}", *(_member(name, members[name], "####") for name in names)]
    return "\n\n".join(parts)


def _member(name: str, item: Any, heading: str = "###") -> str:
    lead, _, rest = dict(facts(item))["meaning"].partition("\n\n")
    lines = [f"{heading} {name}", "", f"{lead[:1].upper()}{lead[1:]}", ""]
    if rest:
        lines += [prose(rest), ""]
    lines += [f"- {key}: {_marked(key, value)}" for key, value in facts(item) if key != "meaning" and value]
    rows = [f"| `{p.name}` | {p.unit} | {p.nominal:g} | {p.meaning} |" for p in parameters(item)]
    if rows:
        lines += ["", "| parameter | unit | nominal | meaning |", "|---|---|---|---|", *rows]
    return "\n".join(lines)


def prose(docstring: str) -> str:
    """Return a docstring as Markdown: paragraphs, sections with their items; formulas and tables as they are set."""
    parts = []
    for block in docstring.split("\n\n"):
        lines = block.strip("\n").splitlines()
        if len(lines) > 1 and set(lines[1]) == {"-"}:
            parts.append(f"**{lines[0]}**")
            lines = lines[2:]
        if all(line.startswith("    ") for line in lines) or lines[0].startswith("==="):
            parts.append("\n".join(["```text", textwrap.dedent("\n".join(lines)), "```"]))
        elif " : " in lines[0]:
            parts.append(_items(lines))
        else:
            parts.append(_escaped(" ".join(lines)))
    return "\n\n".join(parts)


def _items(lines: list[str]) -> str:
    """Return the items "name : what it is" of a section as a list; indented lines continue an item."""
    items: list[str] = []
    for line in lines:
        if line.startswith(" "):
            items[-1] += f" {line.strip()}"
        else:
            names, _, meaning = line.partition(" : ")
            items.append(f"{', '.join(f'`{name}`' for name in names.split(', '))}: {meaning}")
    return "\n".join(f"- {_escaped(item)}" for item in items)


def _escaped(text: str) -> str:
    """Escape what Markdown would read as emphasis or HTML, outside code."""
    parts = text.split("`")
    parts[::2] = [part.replace("*", "\\*").replace("<", "&lt;") for part in parts[::2]]
    return "`".join(parts)


def _marked(key: str, value: str) -> str:
    return f"`{value}`" if key in ("equation", "absent at") else value


# --- the notebook


def notebook_page(path: Path) -> str:
    """Return a notebook with its outputs as Markdown."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    parts = [_cell(cell) for cell in cells]
    note = f"*This page is the notebook [{path.name}]({path.name}), with the outputs of its last run.*"
    return "\n\n".join([parts[0], note, *parts[1:]]) + "\n"


def _cell(cell: dict[str, Any]) -> str:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return source
    return "\n\n".join([f"```python\n{source}\n```", *map(_output, cell["outputs"])])


def _output(output: dict[str, Any]) -> str:
    """Write what a cell shows: the richest form that fits a page, which has a style sheet of its own."""
    if output["output_type"] == "stream":
        return "```text\n" + "".join(output["text"]).strip("\n") + "\n```"
    data = output["data"]
    if "image/png" in data:
        picture = base64.b64encode(base64.b64decode("".join(data["image/png"]))).decode()
        return f'<img alt="output" src="data:image/png;base64,{picture}">'
    if "text/html" in data and "<style" not in "".join(data["text/html"]):
        return f'<div class="output">\n{"".join(data["text/html"])}\n</div>'
    return f'<div class="output"><pre>{html.escape("".join(data["text/plain"]))}</pre></div>'


GENERATED = {
    "keys of a study file": lambda: keys(STUDY_TABLES),
    "keys of a figure's description": lambda: keys(FIGURE_TABLES),
    "commands": commands,
    "simulators": lambda: family("simulators"),
    "effects": effects,
    "features": lambda: family("features"),
    "optimisers": lambda: family("optimisers"),
    "readers": lambda: family("readers"),
}
