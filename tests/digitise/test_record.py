"""Curves of a figure become a record: one clock, its closure, its uncertainty, its nuisances."""

from pathlib import Path

import numpy as np
import pytest
from digitise.figures import cases, round_trip
from echo_study import bench, write_study
from phase_loops import FREQUENCY, clapping

from calib.digitise import digitise
from calib.digitise.spec import read_spec
from calib.errors import CalibError
from calib.records import nuisance_sigma, write
from calib.records.cycles import kind_of_motion
from calib.report.record_description import record_description
from calib.study_file import load

PERIOD = 1.0 / FREQUENCY
ROOT = Path(__file__).parents[2] / "experiments_ref"
DRIVE = f'[excitation]\nplace = "end"\nquantity = "displacement"\namplitude = "1.5 mm"\nfrequency = "{FREQUENCY} Hz"\n'


def loop_rows(body="layer", count=400, **motion):
    one = clapping(periods=1, samples=count, **motion).sel(body=body)
    return np.column_stack([1e3 * one.displacement.values, one.velocity.values])


def time_rows(body="layer", start=0.0, periods=2.3, count=900, channel="displacement", **motion):
    """Time [ms] and displacement [mm] or velocity [m/s], from `start` [s] on."""
    time = np.linspace(0.0, periods * PERIOD, count)
    whole = clapping(periods=4, samples=2000, **motion).sel(body=body)
    values = np.interp(time + start, whole.time.values, whole[channel].values)
    return np.column_stack([1e3 * time, (1e3 if channel == "displacement" else 1.0) * values])


def written(folder, curves, drive=DRIVE, text=""):
    """Write the curves {(body, kind): rows} as one CSV with two header rows, and their description."""
    names = [f"{body} {kind}" for body, kind in curves]
    rows = list(curves.values())
    lines = [",,".join(names) + ",", ",".join(["X,Y"] * len(rows))]
    for k in range(max(len(r) for r in rows)):
        lines.append(",".join(f"{r[k, 0]:.9g},{r[k, 1]:.9g}" if k < len(r) else "," for r in rows))
    (folder / "export.csv").write_text("\n".join(lines) + "\n")
    described = f'source = "made"\n{text}\n{drive}'
    for body, kind in curves:
        units = '["mm", "m/s"]' if kind == "phase curve" else f'["ms", "{"mm" if "displ" in kind else "m/s"}"]'
        described += f'[[curve]]\nbody = "{body}"\nkind = "{kind}"\nname = "{body} {kind}"\nunits = {units}\n'
    (folder / "spec.toml").write_text(described)
    return folder / "export.csv", folder / "spec.toml"


def test_a_phase_curve_becomes_a_record_of_one_period(tmp_path):
    found = digitise(*written(tmp_path, {("layer", "phase curve"): loop_rows()}))
    record = found.record
    assert record.sizes["time"] == 400
    assert record.attrs["frequency"] == FREQUENCY
    assert record.attrs["closure_period_layer"] == pytest.approx(0.0, abs=0.005)
    assert kind_of_motion(record).kind == "period-1"
    assert "sha256" in record.attrs["source"]
    assert record.displacement.values.argmax() in (0, 1, 399)


def test_a_loop_over_two_periods_of_the_excitation_is_period_2(tmp_path):
    one = clapping(periods=2, samples=1000, subharmonic=0.15, jump=0.0, impact=0.3).sel(body="layer")
    rows = np.column_stack([1e3 * one.displacement.values, one.velocity.values])
    record = digitise(*written(tmp_path, {("layer", "phase curve"): rows})).record
    assert kind_of_motion(record).kind == "period-2"
    assert record.sizes["time"] == 800


def test_the_diagram_over_time_gives_the_clock_and_agrees(tmp_path):
    start = 0.013
    curves = {
        (body, kind): loop_rows(body) if kind == "phase curve" else time_rows(body, start)
        for body in ("beam", "layer")
        for kind in ("phase curve", "displacement over time")
    }
    found = digitise(*written(tmp_path, curves))
    truth = clapping(periods=1, samples=400, trigger=start)
    for body in ("beam", "layer"):
        expected = truth.displacement.sel(body=body).values
        off = found.record.displacement.sel(body=body).values - expected
        assert np.sqrt(np.mean(off**2)) < 0.01 * expected.std()
        assert found.record.attrs[f"reconciled_scale_{body}"] == pytest.approx(1.0, abs=0.01)
        assert found.record.attrs[f"reconciled_rest_{body}"] < 0.01
    assert not any("more than" in warning for warning in found.findings.warnings)


def test_diagrams_that_contradict_one_another_are_said(tmp_path):
    larger = time_rows() * (1.0, 1.2)
    found = digitise(
        *written(tmp_path, {("layer", "phase curve"): loop_rows(), ("layer", "displacement over time"): larger})
    )
    assert found.record.attrs["reconciled_scale_layer"] == pytest.approx(1.2, abs=0.02)
    assert any("is it the same motion?" in warning for warning in found.findings.warnings)


def test_phase_curves_of_two_bodies_share_no_clock(tmp_path):
    both = {("layer", "phase curve"): loop_rows(), ("beam", "phase curve"): loop_rows("beam")}
    files = written(tmp_path, both)
    with pytest.raises(CalibError, match="the phase between 'layer' and 'beam' is unknown.*--body layer"):
        digitise(*files)
    assert list(digitise(*files, bodies=["beam"]).record.body.values) == ["beam"]


def test_diagrams_over_time_alone_keep_the_periods_they_show(tmp_path):
    curves = {("layer", f"{c} over time"): time_rows(channel=c) for c in ("displacement", "velocity")}
    record = digitise(*written(tmp_path, curves)).record
    assert record.sizes["time"] == 800
    assert kind_of_motion(record).kind == "period-1"


@pytest.mark.parametrize("periods", [0.975, 0.985, 1.975, 2.98])
def test_a_diagram_that_ends_before_its_period_does_is_continued_by_the_motion(tmp_path, periods):
    """Its last value held over 2.5 % of the period missed the motion by 14 % of the amplitude."""
    rows = time_rows(periods=periods, start=0.007, jump=0.0)
    found = digitise(*written(tmp_path, {("layer", "displacement over time"): rows}))
    record = found.record.sel(body="layer")
    truth = clapping(periods=3, samples=2000, trigger=0.007, jump=0.0).sel(body="layer")
    off = np.abs(record.displacement.values - np.interp(record.time, truth.time, truth.displacement))
    assert off.max() < 0.005 * 3e-3
    assert (off < 4.0 * record.displacement_sigma).all()
    [note] = [note for note in found.findings.notes if "before whole periods" in note]
    assert f"{'1 period(s) earlier' if periods > 1.0 else 'a straight line'}" in note


def test_a_period_2_motion_is_continued_by_what_it_was_two_periods_earlier(tmp_path):
    motion = {"jump": 0.0, "subharmonic": 0.3}
    rows = time_rows(periods=3.975, **motion)
    found = digitise(*written(tmp_path, {("layer", "displacement over time"): rows}))
    truth = clapping(periods=4, samples=2000, **motion).displacement.sel(body="layer")
    off = np.abs(found.record.displacement.values[0] - np.interp(found.record.time, truth.time, truth))
    assert off.max() < 0.005 * 3e-3
    assert any("2 period(s) earlier" in note for note in found.findings.notes)


@pytest.mark.parametrize("periods", [1.0, 2.3])
def test_a_diagram_that_shows_whole_periods_is_not_continued(tmp_path, periods):
    found = digitise(*written(tmp_path, {("layer", "displacement over time"): time_rows(periods=periods)}))
    assert not [note for note in found.findings.notes if "before whole periods" in note]


def test_a_diagram_beside_a_phase_curve_may_end_early(tmp_path):
    start = 0.013
    curves = {
        ("layer", "phase curve"): loop_rows(jump=0.0),
        ("layer", "displacement over time"): time_rows(start=start, periods=0.975, jump=0.0),
    }
    found = digitise(*written(tmp_path, curves))
    expected = clapping(periods=1, samples=400, trigger=start, jump=0.0).displacement.sel(body="layer").values
    assert np.abs(found.record.displacement.values[0] - expected).max() < 0.01 * 3e-3
    assert any("a straight line" in note for note in found.findings.notes)


@pytest.mark.parametrize(
    ("drive", "rows", "said"),
    [
        (DRIVE.replace("25.0", "40.0"), loop_rows(), "1.60 periods of the excitation"),
        (DRIVE, loop_rows()[:, ::-1], "one sign only|no phase curve|periods of the excitation"),
        (DRIVE.replace("25.0 Hz", "157 rad/s"), loop_rows(), "spec.toml:7: excitation.frequency: .*hertz"),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, drive, rows, said):
    with pytest.raises(CalibError, match=said):
        digitise(*written(tmp_path, {("layer", "phase curve"): rows}, drive))


def test_without_an_excitation_the_loop_gives_the_period_and_it_is_said(tmp_path):
    found = digitise(*written(tmp_path, {("layer", "phase curve"): loop_rows()}, drive=""))
    assert found.record.attrs["frequency"] == pytest.approx(FREQUENCY, rel=0.005)
    assert "no frequency" in found.record.attrs["warning"]


def test_points_that_are_not_in_order_are_put_in_order(tmp_path):
    rows = np.random.default_rng(0).permutation(loop_rows("beam", count=150))
    found = digitise(*written(tmp_path, {("beam", "phase curve"): rows}))
    assert any("not in order" in note for note in found.findings.notes)
    assert found.record.attrs["closure_period_beam"] == pytest.approx(0.0, abs=0.01)


def test_a_table_describes_itself(tmp_path):
    rows = loop_rows()
    head = ['source = "bench"', *DRIVE.splitlines(), "[[curve]]", 'body = "layer"', 'kind = "phase curve"',
            'columns = ["q", "v"]', 'units = ["mm", "m/s"]', 'sigma = ["0.01 mm", "2 mm/s"]']  # fmt: skip
    path = tmp_path / "own.csv"
    path.write_text("".join(f"# {line}\n" for line in head) + "q,v\n" + "".join(f"{q:.6f},{v:.6f}\n" for q, v in rows))
    record = digitise(path).record
    assert record.displacement_sigma.min() >= 0.99e-5
    path.write_text(path.read_text().replace('kind = "phase curve"', 'kind = "phase curv"'))
    with pytest.raises(CalibError, match=r"own.csv:9: curve\[1\].kind: .*did you mean 'phase curve'"):
        digitise(path)


def test_the_stated_uncertainty_grows_where_velocity_changes_fast(tmp_path):
    record = digitise(*written(tmp_path, {("layer", "phase curve"): loop_rows(jump=0.5)})).record
    sigma, velocity = record.velocity_sigma.values[0], record.velocity.values[0]
    at = int(np.argmax(np.abs(np.diff(velocity))))
    assert sigma[at - 1 : at + 3].max() > 3.0 * np.median(sigma)


def test_the_prepared_description_of_the_paper_s_figure_is_one(tmp_path):
    shape, _ = read_spec(ROOT / "clapping_beam" / "figure2.toml")
    assert {(c.body, c.kind) for c in shape.curve} == {
        (body, kind) for body in ("beam", "layer") for kind in ("phase curve", "displacement over time")
    }


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "phase curve"', 'kind = "phase"', r"spec.toml:10: curve\[1\].kind: "),
        ('units = ["mm", "m/s"]', 'units = ["mm", "kg"]', r"spec.toml:8: curve\[1\]: .*kg"),
        ('units = ["mm", "m/s"]', "", r"units are missing"),
        ('name = "layer phase curve"', 'name = "layer"', r"there is no curve 'layer'"),
        ('body = "layer"', 'boddy = "layer"', r"unknown key \(did you mean 'body'\?\)"),
        ('units = ["mm", "m/s"]', 'units = ["mm", "m/s"]\ncolour = "black"', r"colour belongs to a curve in a picture"),
    ],
)
def test_a_mistake_in_the_description_is_said_with_its_line(tmp_path, old, new, said):
    files = written(tmp_path, {("layer", "phase curve"): loop_rows()})
    files[1].write_text(files[1].read_text().replace(old, new))
    with pytest.raises(CalibError, match=said):
        digitise(*files)


def test_a_study_solves_for_what_the_record_leaves_open(tmp_path):
    path = write_study(tmp_path, ('nuisance = ["trigger"]\n', ""))
    record = bench().assign_attrs(nuisance="trigger, offset, shear")
    write(record, tmp_path / "bench.nc")
    [reference] = load(path).study.objective.references.values()
    assert reference.nuisance == ("trigger", "offset", "shear")


def test_the_record_states_what_its_axes_leave_open(tmp_path):
    record = round_trip(cases()[0], tmp_path)[0].record
    assert record.attrs["nuisance"] == "trigger, offset, shear"
    sure = nuisance_sigma(record)
    assert set(sure) == {"scale.displacement", "scale.velocity", "shear", "offset.layer"}
    assert 1e-4 < sure["scale.displacement"] < 5e-3
    text = "\n".join(record_description(record))
    assert "nuisances: trigger, offset, shear" in text
    assert f"scale of displacement {100.0 * sure['scale.displacement']:.2g} %" in text
    assert f"shear {1e6 * sure['shear']:.2g} us" in text
