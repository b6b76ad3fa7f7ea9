"""What other digitising tools write is read, or refused by name; nothing outside the file is touched."""

import io
import json
import tarfile

import numpy as np
import pytest
from scipy.spatial import cKDTree

from calib.digitise.importers import content, read
from calib.digitise.importers import webplotdigitizer as wpd
from calib.errors import CalibError

READ = {  # file: names of its curves and their points
    "engauge/endpoints.dig": {"CurveTop": 5, "CurveMiddle": 4, "CurveBottom": 3},
    "engauge/export_only_all_curves_on_same_line.csv": {"Curve1": 39, "Curve2": 36, "Curve3": 40},
    "engauge/export_only_one_curve_per_line.csv": {"Curve1": 39, "Curve2": 36, "Curve3": 40},
    "engauge/four_sides_relations.csv": {"Curve1": 4, "Curve2": 4, "Curve3": 4},
    "engauge/four_sides_relations.dig": {"Curve1": 4, "Curve2": 4, "Curve3": 4},
    "engauge/gnuplot_format.csv": {"red": 74, "green": 58, "blue": 60},
    "engauge/interpolation.csv": {"Curve1": 45},
    "engauge/interpolation.dig": {"Curve1": 4},
    "engauge/polar_linear_linear_3curve.csv": {"Curve1": 188, "Curve2": 188, "Curve3": 188},
    "engauge/two_bumps.csv": {"CurveLeft": 55},
    "engauge/two_bumps.dig": {"CurveLeft": 55},
    "engauge/version10_1.csv": {"Curve1": 123},
    "engauge/version10_1.dig": {"Curve1": 9},
    "engauge/version5_3.csv": {"Curve1": 9},
    "wpd/aerosandbox-humanpower-log_wpd.json": {
        "Healthy Men": 63, "First-Class Athletes": 75, "World-Class Athletes": 91,
    },
    "wpd/aerosandbox-humanpower_single-dataset-no-header.csv": {
        "aerosandbox-humanpower_single-dataset-no-header": 63,
    },
    "wpd/aerosandbox-microturbines_datasets.csv": {"M0.3": 44, "M0.6": 44, "M0.9": 44},
    "wpd/aerosandbox-microturbines_wpd.json": {"M0.3": 44, "M0.6": 44, "M0.9": 44},
    "wpd/aerosandbox-turboshaft_wpd.json": {"Default Dataset": 26},
    "wpd/automeris-wpd3_xy.json": {"blue": 144, "yellow": 147, "red": 56, "green": 56},
    "wpd/automeris-wpd4.json": {"xy data": 144},
    "wpd/automeris-wpd4_2_with_masks.json": {"xy data": 143},
    "wpd/wpdjl-default_v4_project.tar": {"Dataset 1": 103, "Dataset 2": 143, "Dataset 3": 146, "Dataset 4": 57},
}  # fmt: skip
REFUSED = {  # file: what is said
    "engauge/time_scale.csv": "line 2: expected a number in column 'x', got '07/06/2009 00:36:07'; dates are not read",
    "engauge/version5_3.dig": "versions up to 5 wrote a binary format",
    "wpd/aerosandbox-humanpower-log_info.json": "the index of a project, not the project; give 'wpd.json'",
    "wpd/aerosandbox-linkagedrag-bar_info.json": "the index of a project",
    "wpd/aerosandbox-linkagedrag-bar_wpd.json": "Re2e5: it is a bar chart",
    "wpd/aerosandbox-linkagedrag_bar-datasets.csv": "Re2e5: it is a bar chart",
    "wpd/aerosandbox-microturbines_info.json": "the index of a project",
    "wpd/aerosandbox-turboshaft_info.json": "the index of a project",
    "wpd/automeris-wpd3_bar.json": "Default Dataset: it is a bar chart",
    "wpd/wpdjl-dateandtime_wpd.json": "D2: x of its axes 'Datetime' carries dates or times of day ('2020/09/01 11:00')",
    "wpd/wpdjl-not-a-project.tar": "it has no info.json (it holds dummyfile)",
}


def test_every_sample_is_judged(samples):
    here = {str(path.relative_to(samples)) for path in samples.glob("*/*")}
    assert here == set(READ) | set(REFUSED)


@pytest.mark.parametrize("name", READ)
def test_a_sample_is_read(samples, name):
    found = read(samples / name)
    assert {curve.name: len(curve.points) for curve in found.curves} == READ[name]


@pytest.mark.parametrize("name", REFUSED)
def test_a_sample_is_refused_with_its_name_and_the_reason(samples, name):
    with pytest.raises(CalibError) as raised:
        read(samples / name)
    assert str(samples / name) in str(raised.value)
    assert REFUSED[name] in str(raised.value)


def test_what_is_no_plot_of_y_over_x_is_refused_by_name(samples):
    refused = read(samples / "wpd/automeris-wpd4.json").refused
    assert set(refused) == {"bar data", "polar data", "ternary data", "map data", "image data"}


@pytest.mark.parametrize("name", ["microturbines", "humanpower-log"])
def test_a_project_holds_what_its_csv_holds(samples, name):
    table = {"microturbines": "microturbines_datasets", "humanpower-log": "humanpower_single-dataset-no-header"}[name]
    project = read(samples / f"wpd/aerosandbox-{name}_wpd.json").curves
    for ours, theirs in zip(project, read(samples / f"wpd/aerosandbox-{table}.csv").curves, strict=False):
        np.testing.assert_allclose(ours.points, theirs.points, rtol=1e-12)


@pytest.mark.parametrize("name", [n for n in READ if n.endswith((".json", ".tar"))])
def test_the_calibration_gives_the_numbers_of_webplotdigitizer(samples, name, monkeypatch):
    stored = read(samples / name).curves
    monkeypatch.setattr(wpd, "_value", lambda datum, own: own)
    for ours, theirs in zip(read(samples / name).curves, stored, strict=True):
        np.testing.assert_allclose(ours.points, theirs.points, rtol=1e-6, atol=1e-6 * np.ptp(theirs.points))


@pytest.mark.parametrize("name", ["four_sides_relations", "two_bumps"])
def test_the_calibration_gives_the_numbers_of_engauge(samples, name):
    document, table = read(samples / f"engauge/{name}.dig").curves, read(samples / f"engauge/{name}.csv").curves
    for ours, theirs in zip(document, table, strict=True):
        np.testing.assert_allclose(ours.points, theirs.points, rtol=2e-4, atol=1e-4)


@pytest.mark.parametrize("name", ["version10_1", "interpolation"])
def test_the_points_of_engauge_lie_on_the_line_that_it_drew_through_them(samples, name):
    [document], [table] = read(samples / f"engauge/{name}.dig").curves, read(samples / f"engauge/{name}.csv").curves
    size = np.ptp(table.points, axis=0)
    along = np.linspace(0.0, len(table.points) - 1.0, 20_000)
    line = np.column_stack([np.interp(along, np.arange(len(table.points)), table.points[:, k]) for k in (0, 1)])
    distance = cKDTree(line / size).query(document.points / size)[0]
    assert distance.max() < 0.02  # the line of one is sampled coarsely, of the other begins beside its first point


def test_the_uncertainty_of_a_click_is_in_the_units_of_the_axes(samples):
    [curve, *_] = read(samples / "wpd/aerosandbox-microturbines_wpd.json").curves
    pixel = 40000.0 / (3123.16 - 256.70)
    np.testing.assert_allclose(curve.sigma[:, 0], 0.5 * pixel, rtol=1e-3)


# --- plain tables


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("x,y\n1,2\n3,4\n", {"x": [1, 3], "y": [2, 4]}),
        ("x;y\n1,5;2\n3;4\n", {"x": [1.5, 3], "y": [2, 4]}),
        ("x\ty\n1\t2\n3\t4\n", {"x": [1, 3], "y": [2, 4]}),
        ("# a = 1\n#\nx y\n1 2\n3 4\n", {"x": [1, 3], "y": [2, 4]}),
        ("sep=;\nx;y\n1,5;2\n3;4\n", {"x": [1.5, 3], "y": [2, 4]}),
        ("x;y\n0,5;1,234\n1,5;2,345\n", {"x": [0.5, 1.5], "y": [1.234, 2.345]}),  # no thousands: x has decimal commas
        ("x\ty\n1,5\t2\n3\t4,25\n", {"x": [1.5, 3], "y": [2, 4.25]}),
        ("x, mm;y\n1,5;2\n3;4\n", {"x, mm": [1.5, 3], "y": [2, 4]}),
        ("x,y\n\u22121,2\n3,\u22124\n", {"x": [-1, 3], "y": [2, -4]}),
    ],
)
def test_a_plain_table_is_read(tmp_path, text, columns):
    (tmp_path / "t.csv").write_text(text)
    found = read(tmp_path / "t.csv")
    assert {name: list(values) for name, values in found.columns.items()} == columns


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("t.csv", "x,y\n1,two\n", "line 2: expected a number in column 'y', got 'two'"),
        ("t.csv", "x,y\n1,2,3\n", "line 2: expected 2 cells, got 3"),
        ("t.csv", "x,x\n1,2\n", "two columns have one name"),
        (
            "t.csv",
            "x;y\n1;1,234\n2;1,500\n",
            "line 2: expected one decimal sign and nothing between the thousands, got '1,2",
        ),
        ("t.csv", "x;y\n0.5;1,234\n0.6;900\n", "line 2: expected one decimal sign"),
        (
            "t.csv",
            "x;y\n1;999\n2;1,234.5\n",
            "line 3: expected one decimal sign and nothing between the thousands, got '1,2",
        ),
        (
            "t.csv",
            "x;y\n0,5;1.234\n0,6;1.500\n",
            "line 2: expected one decimal sign and nothing between the thousands, got '1.2",
        ),
        ("t.csv", "", "holds no rows"),
        ("t.csv", "x,y\n1,2\n", "it has 1 point(s)"),
        ("t.json", "{", "not a readable JSON file"),
        ("t.json", "[" * 100_000, "not a readable JSON file"),
        ("t.json", "{}", "not a WebPlotDigitizer project"),
        ("t.dig", "<a>", "not readable XML"),
        ("t.dig", "<a/>", "expected an Engauge <Document>"),
        ("t.tar", "no tar", "not a readable plain .tar"),
        ("t.xyz", "", ".xyz is not read"),
    ],
)
def test_what_is_wrong_is_said_with_the_file(tmp_path, name, text, said):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(CalibError) as raised:
        read(path)
    assert str(path) in str(raised.value)
    assert said in str(raised.value)


# --- nothing outside the file


def archive(path, members):
    with tarfile.open(path, "w") as tar:
        for name, payload in members:
            info = tarfile.TarInfo(name)
            if isinstance(payload, bytes):
                info.size = len(payload)
                tar.addfile(info, io.BytesIO(payload))
            else:
                info.type, info.linkname = payload
                tar.addfile(info)
    return path


PROJECT = json.dumps({"axesColl": [], "datasetColl": []}).encode()


@pytest.mark.parametrize("target", ["../secret.json", "/etc/passwd", "secret.json"])
def test_a_project_that_points_out_of_its_archive_is_refused(tmp_path, target):
    (tmp_path / "secret.json").write_bytes(PROJECT)
    info = json.dumps({"json": target}).encode()
    path = archive(tmp_path / "p.tar", [("p/info.json", info)])
    with pytest.raises(CalibError, match="is not in the archive"):
        read(path)


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE])
def test_a_link_in_an_archive_is_not_followed(tmp_path, kind):
    (tmp_path / "secret.json").write_bytes(PROJECT)
    members = [("p/info.json", b'{"json": "wpd.json"}'), ("p/wpd.json", (kind, str(tmp_path / "secret.json")))]
    with pytest.raises(CalibError, match="is not in the archive"):
        read(archive(tmp_path / "p.tar", members))


def test_nothing_is_written_beside_an_archive(tmp_path):
    folder = tmp_path / "in" / "here"
    folder.mkdir(parents=True)
    members = [("../../escaped.txt", b"x"), ("/tmp/calib-escaped.txt", b"x"), ("p/info.json", b'{"json": "w"}')]
    with pytest.raises(CalibError):
        read(archive(folder / "p.tar", members))
    assert [str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()] == ["in/here/p.tar"]


def test_a_member_that_claims_to_be_huge_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(wpd, "MAX_CONTENT_BYTES", 1000)
    members = [("p/info.json", b'{"json": "wpd.json"}'), ("p/wpd.json", b" " * 2000)]
    with pytest.raises(CalibError, match="larger than the 1000 bytes"):
        read(archive(tmp_path / "p.tar", members))


def test_a_compressed_archive_is_not_unpacked(tmp_path):
    with tarfile.open(tmp_path / "p.tar", "w:gz") as tar:
        tar.addfile(tarfile.TarInfo("p/info.json"), io.BytesIO(b""))
    with pytest.raises(CalibError, match="not a readable plain .tar"):
        read(tmp_path / "p.tar")


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(content, "MAX_CONTENT_BYTES", 10)
    (tmp_path / "t.csv").write_text("x,y\n1,2\n3,4\n")
    with pytest.raises(CalibError, match="12 bytes are more than the 10 that are read"):
        read(tmp_path / "t.csv")


@pytest.mark.parametrize(
    "entity",
    [
        '<!ENTITY a SYSTEM "file:///etc/passwd">',
        '<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">',
        '<!ENTITY % a SYSTEM "http://127.0.0.1/x"> %a;',
    ],
)
def test_entities_in_xml_are_refused(tmp_path, entity):
    path = tmp_path / "t.dig"
    path.write_text(f'<?xml version="1.0"?><!DOCTYPE engauge [{entity}]><Document>&a;</Document>')
    with pytest.raises(CalibError, match="entities in the XML are not read"):
        read(path)


@pytest.mark.parametrize("cell", ["mm5", "Hz2", "A3"])
def test_letters_before_a_number_are_no_mark_of_engauge(tmp_path, cell):
    path = tmp_path / "points.csv"
    path.write_text(f"x,y\n1.0,2.0\n2.0,{cell}\n")
    with pytest.raises(CalibError, match="line 3: expected a number in column 'y'"):
        read(path)
