"""Docstrings of the house, "name : what it is", as mkdocstrings reads them."""

import re

import griffe

SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Yields")
ITEM = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*) : +(.*)$")


class HouseDocstrings(griffe.Extension):
    """Put what follows the colon into the description: types are those of the annotations."""

    def on_instance(self, *, obj: griffe.Object, **_) -> None:
        """Rewrite the docstring of an object as it is loaded."""
        if obj.docstring is not None:
            obj.docstring.value = rewritten(obj.docstring.value)


def rewritten(text: str) -> str:
    """Return a docstring with the description of each item beneath its name, and each name an item."""
    lines, found, section = text.splitlines(), [], ""
    while lines:
        line = lines.pop(0)
        if lines and lines[0] and set(lines[0]) == {"-"}:
            section = line.strip()
            found += [line, lines.pop(0)]
        elif section not in SECTIONS or not line or line.startswith(" "):
            found.append(line)
        else:
            further = []
            while lines and lines[0].startswith(" "):
                further.append(lines.pop(0))
            found += _items(section, line, further)
    return "\n".join(found)


def _items(section: str, line: str, further: list[str]) -> list[str]:
    named = ITEM.match(line)
    if named is None:
        return [":", f"    {line}", *further] if section in ("Returns", "Yields") else [line, *further]
    colon = " :" if section in ("Returns", "Yields") else ""
    return [part for name in named[1].split(", ") for part in (f"{name}{colon}", f"    {named[2]}", *further)]
