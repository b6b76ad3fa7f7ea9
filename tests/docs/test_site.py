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


def test_every_key_of_a_study_file_and_of_a_figure_is_explained(site):
    for schema, name in ((StudyToml, "study-file"), (FigureToml, "digitise")):
        text = (site / "how-to" / f"{name}.html").read_text(encoding="utf-8")
        for table in schema.model_json_schema()["$defs"].values():
            for key, said in table.get("properties", {}).items():
                assert f"<code>{key}</code>" in text
                assert said.get("description"), f"{key} of {table['title']} says nothing of itself"


def test_every_command_and_option_is_explained(site):
    text = (site / "how-to" / "commands.html").read_text(encoding="utf-8")
    for path, command in commands(main, "calib"):
        assert f">{path}<" in text
        for option in (o for p in command.params if isinstance(p, click.Option) for o in p.opts):
            assert re.search(rf"<code>{re.escape(option)}[ <]", text), f"{path} {option}"


def commands(group, path):
    """Yield the commands of a group with their paths."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{path} {name}")
        else:
            yield f"{path} {name}", command


def test_every_member_of_a_family_is_listed(site):
    text = (site / "reference" / "catalogue.html").read_text(encoding="utf-8")
    for group in plugins.GROUPS:
        for name in plugins.names(group):
            assert f'id="{name}"' in text
