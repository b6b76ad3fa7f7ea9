"""Every code block of the README and of the site runs, page by page, as a reader would run it."""

import json
import re
from pathlib import Path

import matplotlib as mpl
import pytest
from docs.blocks import LANGUAGES, ROOT, blocks, play, takes_long

PAGES = sorted((ROOT / "docs").rglob("*.md"))
CONTRACTS = ROOT / "docs" / "reference" / "contracts.md"
NOTEBOOK = ROOT / "docs" / "tutorials" / "notebook.ipynb"


def with_code():
    """Pages that have something to run; those that take long are slow tests."""
    pages = [page for page in [ROOT / "README.md", *PAGES] if any(block.language != "text" for block in blocks(page))]
    pages.remove(CONTRACTS)  # played by a test of its own
    return [
        pytest.param(page, marks=[pytest.mark.slow] if takes_long(page) else [], id=page.relative_to(ROOT).as_posix())
        for page in pages
    ]


@pytest.fixture
def desk(tmp_path, monkeypatch) -> Path:
    """An empty folder with the repository's studies and records in it, which is the working directory."""
    for folder in ("studies", "experiments_ref"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    with mpl.rc_context():
        yield tmp_path


@pytest.mark.parametrize("page", with_code())
def test_its_blocks_run(page, desk, capsys):
    play(page, desk)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_its_blocks_say_what_they_are(page):
    languages = {block.language for block in blocks(page)}
    assert languages <= set(LANGUAGES), "a block runs as python, sh or toml, or is text that a reader sees"
    assert page.read_text(encoding="utf-8").count("\n```") == 2 * len(blocks(page)), "a block that is not seen as one"


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom(desk):
    names: dict = {"__name__": "__main__"}
    cells = [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, start=1):
        exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, code cell {number}", "exec"), names)
    for name, truth in (("stiffness", 4000.0), ("damping", 5.0)):
        assert names["found"].values[name] == pytest.approx(truth, rel=0.01)
    assert (desk / "spring.html").is_file()
    assert (desk / "spring" / "study.toml").is_file()


def test_the_notebook_holds_what_its_cells_have_shown():
    cells = [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert not [output for cell in cells for output in cell["outputs"] if output["output_type"] == "error"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_its_links_outside_the_site_lead_somewhere(page):
    """Links within the site are followed when it is built; names of files of the repository are followed here."""
    named = re.findall(r"`((?:studies|experiments_ref|tests|docs)/[\w./-]+)`", page.read_text(encoding="utf-8"))
    missing = [name for name in named if not (ROOT / name).exists() and "/out/" not in name]
    assert not missing


def test_the_kernel_of_the_contracts_integrates_internal_states(desk, capsys):
    play(CONTRACTS, desk)
    without, friction = (float(line.split()[0]) for line in capsys.readouterr().out.splitlines())
    assert abs(friction - without) > 1e-5  # m, of 1e-3
