"""What is said of a reference record, and the commands that make and show one."""

import re

import numpy as np
import pytest
from click.testing import CliRunner
from digitise.figures import cases, description, motion
from digitise.rendered import draw
from phase_loops import clapping, noisy
from PIL import Image

from calib import records
from calib.cli import main
from calib.records import STATE, write
from calib.records.response import make_response
from calib.report.record_description import MIN_CONTACT_SAMPLES, record_description, record_warnings


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


def test_a_sound_record_gives_no_cause_for_care():
    assert list(record_warnings(noisy(clapping(jump=0.0)))) == []


def test_a_velocity_that_is_not_the_derivative_is_said():
    record = noisy(clapping(jump=0.0))
    record["velocity"] = record.velocity.copy(data=1.1 * record.velocity.values)
    start = "layer: the velocity is not the derivative of the displacement"
    [line] = [line for line in record_warnings(record) if line.startswith(start)]
    share, factor = re.search(r"([\d.]+) % .*?([\d.]+) times as large", line).groups()
    assert float(factor) == pytest.approx(1.1, abs=0.005)
    assert float(share) == pytest.approx(10.0, abs=1.0)


def test_a_loop_that_is_not_closed_is_said():
    record = noisy(clapping(jump=0.0, periods=1))
    drift = 1e-3 * record.time.values / float(record.time[-1])
    record["displacement"] = record.displacement.copy(data=record.displacement.values + drift)
    told = [re.fullmatch(r"(\w+): the phase curve is not closed: displacement changes by ([\d.]+) mm .*", line)
            for line in record_warnings(record)]  # fmt: skip
    assert [line[1] for line in told] == ["beam", "layer"]
    assert [float(line[2]) for line in told] == pytest.approx([1.0, 1.0], abs=0.05)  # noise and a usual step beside


def test_an_impact_that_the_samples_do_not_resolve_is_said():
    [line] = record_warnings(noisy(clapping()))
    phase, samples = re.match(
        r"layer: the impact at phase ([\d.]+) lasts ([\d.]+) samples: its duration", line
    ).groups()
    assert float(phase) == pytest.approx(0.3012, abs=1.0 / 400)
    assert float(samples) < MIN_CONTACT_SAMPLES


@pytest.mark.parametrize(("stated", "periods"), [(14.0, 20), (11.4, 20), (26.0 / 3.1, 20), (15.5, 5)])
def test_a_record_that_repeats_at_another_frequency_than_is_stated_is_said(stated, periods):
    [line] = [line for line in record_warnings(_tone(13.0, stated, periods)) if "repeats itself" in line]
    found, said = re.match(r"the record repeats itself at ([\d.]+) Hz, not at the ([\d.]+) Hz of", line).groups()
    assert float(found) == pytest.approx(13.0, abs=0.4 / periods)
    assert float(said) == pytest.approx(stated, abs=0.005)


@pytest.mark.parametrize("stated", [13.0, 13.005, 26.0, 39.0])
def test_a_record_at_its_frequency_or_at_a_fraction_of_it_is_not_doubted(stated):
    assert not [line for line in record_warnings(_tone(13.0, stated)) if "repeats itself" in line]


def test_uncertainties_and_instants_are_no_motion_that_could_repeat():
    first = _tone(13.0, 14.0)
    force = first.rename(displacement="force")[["displacement_sigma", "force"]]
    assert any("repeats itself at 13" in line for line in record_warnings(force))


def _tone(frequency, stated, periods=20):
    """Periods of a motion with harmonics and noise, whose excitation is said to be at `stated` [Hz]."""
    time = np.arange(0.0, periods / 13.0, 1e-3)
    angle = 2.0 * np.pi * frequency * time
    noise = 1e-5 * np.random.default_rng(2).standard_normal(time.size)
    displacement = 1e-3 * (np.cos(angle) + 0.2 * np.cos(2.0 * angle + 0.5)) + noise
    return records.make(
        time, ("mass",), {"displacement": displacement[None], "displacement_sigma": np.array([1e-5])}, frequency=stated
    )


def test_a_record_without_uncertainty_is_said():
    assert list(record_warnings(clapping(jump=0.0))) == [f"{name} states no uncertainty" for name in STATE]


def test_the_energy_of_the_impact_comes_back_over_the_cycle():
    [line] = [
        text
        for text in record_description(clapping(jump=0.4, samples=4000))
        if text.startswith("kinetic energy of layer")
    ]
    lost, regained = (float(part.split()[0]) for part in line.split(" by ")[2:4])
    assert lost == pytest.approx(-regained, abs=1e-3)
    before, after = clapping(jump=0.4, samples=4000).velocity.sel(body="layer").values[[1203, 1206]]
    assert lost == pytest.approx(0.5 * (after**2 - before**2), abs=0.01)


def test_the_picture_and_the_words_of_a_record(tmp_path):
    write(noisy(clapping()), tmp_path / "r.nc")
    text = calib("reference", "show", tmp_path / "r.nc").stdout.splitlines()
    described = [*record_description(noisy(clapping())), *map("warning: {}".format, record_warnings(noisy(clapping())))]
    assert text == [*described, f"picture: {tmp_path / 'r.png'}"]
    assert text[0] == "2400 samples at intervals of 0.1 ms, 240 ms in all"
    assert text[1] == "excitation: displacement at the end, 25 Hz, amplitude 1.5 mm"
    assert text[2].startswith("kind of motion: period-1 (6 cycles of the record")
    with Image.open(tmp_path / "r.png") as picture:
        assert np.asarray(picture.convert("L")).std() > 10.0


def test_a_figure_from_the_command_line(tmp_path):
    case, drawn = cases()[0], motion(cases()[0])
    one = drawn.sel(body="layer")
    loop = np.column_stack([1e3 * one.displacement.values, one.velocity.values])
    figure = draw(tmp_path / "figure", [np.vstack([loop, loop[:1]])], case.look)
    (tmp_path / "spec.toml").write_text(description(figure, case, "layer"))
    listed = calib("digitise", figure.path, "--spec", tmp_path / "spec.toml", "--list").stdout
    assert "layer: phase curve" in listed
    text = calib("digitise", figure.path, "--spec", tmp_path / "spec.toml", "-o", tmp_path / "out" / "r.nc").stdout
    assert "once round in" in text
    with Image.open(tmp_path / "out" / "r.overlay.png") as overlay:
        pixels = np.asarray(overlay.convert("RGB")).astype(int)
    assert ((pixels[:, :, 0] - pixels[:, :, 2]) > 120).sum() > 500  # the trace is there, in its colour


def test_the_curves_of_a_file_are_listed(tmp_path):
    (tmp_path / "t.csv").write_text("a,,b,\nX,Y,Label,Y\n1,2,,5\n3,4,,6\n")
    first, *curves = calib("digitise", tmp_path / "t.csv", "--list").stdout.splitlines()
    assert first == f"{tmp_path / 't.csv'}: WebPlotDigitizer CSV, two header rows"
    assert curves == [
        "  a: 2 points, x 1 .. 3, y 2 .. 4",
        "  b: not read: it is a bar chart, whose points carry one number each; expected a plot of y over x",
    ]


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["t.csv"], 2, "Missing option '-o'"),
        (["t.csv", "-o", "r.nc"], 1, "its numbers are not described"),
        (["none.csv", "-o", "r.nc"], 1, "none.csv: no such file"),
        (["p.png", "-o", "r.nc"], 1, "a picture needs a description"),
        (["t.csv", "-o", "r.png"], 2, "is the name of a picture"),
    ],
)
def test_what_is_missing_is_said(tmp_path, monkeypatch, arguments, code, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("1,2\n3,4\n")
    assert text in calib("digitise", *arguments, code=code).stderr


def test_a_curve_in_another_colour_is_refused_with_the_place(tmp_path):
    case, drawn = cases()[0], motion(cases()[0])
    one = drawn.sel(body="layer")
    figure = draw(tmp_path / "f", [np.column_stack([1e3 * one.displacement.values, one.velocity.values])], case.look)
    spec = description(figure, case, "layer").replace(case.look.colours[0], "#00ff00")
    (tmp_path / "spec.toml").write_text(spec)
    ended = calib("digitise", figure.path, "--spec", tmp_path / "spec.toml", "-o", tmp_path / "r.nc", code=1)
    place = f"{tmp_path / 'spec.toml'}:"
    assert ended.stderr.startswith(f"calib: {place}"), ended.stderr
    assert "curve[1]: curve 'layer': no line of its colour in the panel" in ended.stderr
    assert not (tmp_path / "r.nc").exists()


@pytest.mark.parametrize(
    ("turned", "quantity", "doubted"), [(1, "force", False), (-1, "force", True), (-1, "base motion", False)]
)
def test_a_structure_that_would_do_work_on_its_exciter_is_doubted(turned, quantity, doubted):
    """Phases of another sign, or of the acceleration: no passive structure leads the force that drives it."""
    frequency = np.linspace(2.0, 4.0, 41)
    omega = 2.0 * np.pi * frequency
    receptance = 1.0 / (400.0 - omega**2 + 1j * turned * omega)
    unit = {"force": "N", "base motion": "m"}[quantity]
    record = make_response(frequency, ["mass"], receptance[None], 1.0, unit, place="mass", quantity=quantity)
    assert any("do work on its exciter" in line for line in record_warnings(record)) == doubted
