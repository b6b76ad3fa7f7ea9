"""The site is built with warnings as errors, needs no network, and says what the code says."""

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import click
import pytest
from docs.blocks import ROOT

from calib import plugins
from calib.cli import main
from calib.digitise.spec import FigureToml
from calib.study_file import StudyToml

pytestmark = pytest.mark.slow


class Page(HTMLParser):
    """Links, anchors and text of a page."""

    def __init__(self, path: Path):
        super().__init__()
        self.path, self.links, self.loaded, self.anchors = path, [], [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        known = dict(attrs)
        self.anchors.update(filter(None, (known.get("id"), known.get("name"))))
        if tag == "a" and known.get("href"):
            self.links.append(known["href"])
        elif tag in ("script", "img", "iframe") and known.get("src"):
            self.loaded.append(known["src"])
        elif tag == "link" and known.get("rel") in ("stylesheet", "preload", "preconnect", "icon"):
            self.loaded.append(known["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site, or a skip where the documentation's extra is not installed."""
    if importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("mkdocstrings") is None:
        if os.environ.get("CALIB_DOCS_REQUIRED"):
            pytest.fail("the extra calib[docs] is not installed")
        pytest.skip("the extra calib[docs] is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[-4000:]
    return folder


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, Page]:
    """Pages of the site by their files."""
    return {path.resolve(): Page(path) for path in site.rglob("*.html")}


def test_every_link_and_anchor_leads_somewhere(pages):
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue  # its links are those of the root of a server
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            known = pages[target].anchors if target in pages else None
            if not target.exists() or (parts.fragment and known is not None and unquote(parts.fragment) not in known):
                broken.append(f"{path.name}: {link}")
    assert not broken


def test_nothing_is_loaded_from_elsewhere(site, pages):
    assert not [source for page in pages.values() for source in page.loaded if urlsplit(source).netloc]
    styles = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    assert not re.findall(r"url\(['\"]?https?:", styles)


@pytest.mark.parametrize(("schema", "name"), [(StudyToml, "study-file"), (FigureToml, "digitise")])
def test_every_key_of_a_study_file_and_of_a_figure_is_explained(site, schema, name):
    text = (site / "how-to" / f"{name}.html").read_text(encoding="utf-8")
    tables = schema.model_json_schema()["$defs"].values()
    said = {(table["title"], key): value for table in tables for key, value in table.get("properties", {}).items()}
    assert len(said) > 10
    assert [where for where in said if f"<code>{where[1]}</code>" not in text] == []
    assert [where for where, value in said.items() if not value.get("description")] == []


def test_every_command_and_option_is_explained(site):
    text = (site / "how-to" / "commands.html").read_text(encoding="utf-8")
    known = dict(commands(main, "calib"))
    assert known
    assert [path for path in known if f">{path}<" not in text] == []
    options = {o for command in known.values() for p in command.params if isinstance(p, click.Option) for o in p.opts}
    assert options
    assert [option for option in options if not re.search(rf"<code>{re.escape(option)}[ <]", text)] == []


def commands(group, path):
    """Yield the commands of a group with their paths."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{path} {name}")
        else:
            yield f"{path} {name}", command


@pytest.mark.parametrize("group", plugins.GROUPS)
def test_every_member_of_a_family_is_listed(site, group):
    text = (site / "reference" / "catalogue.html").read_text(encoding="utf-8")
    names = plugins.names(group)
    assert names
    assert [name for name in names if f'id="{name}"' not in text] == []
